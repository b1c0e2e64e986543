"""Runs picamera2 in the system's own Python: started as a file by ``picamera``, and imports nothing of landslope.

Raspberry Pi OS builds picamera2 for its own numpy; in one process with another numpy it does not import. Here are only
the system's packages. Frames go out on standard output: MAGIC, stamp (ns, CLOCK_BOOTTIME), rows, bytes a row, then the
grey rows. What goes wrong comes as one FAULT with a length and JSON. Ends when nobody reads any more.
"""

import json
import os
import struct
import sys

MAGIC, FAULT = b"LSPF", b"LSPE"
FRAME = struct.Struct("<QII")
LENGTH = struct.Struct("<I")


def main(arguments):
    """Frames of camera NUMBER at WIDTH, HEIGHT, FRAME_US, EXPOSURE_US (0: automatic), GAIN (negative: automatic)."""
    out = os.fdopen(os.dup(1), "wb", buffering=0)
    os.dup2(2, 1)  # what libraries print must not come between the frames
    number, width, height, frame_us, exposure_us = (int(a) for a in arguments[:5])
    gain = float(arguments[5])
    try:
        from picamera2 import Picamera2
    except Exception as error:  # noqa: BLE001 foreign packages fail to import in any way they like
        return fail(out, "import", error)
    try:
        run(out, Picamera2(number), (width, height), frame_us, exposure_us, gain)
    except BrokenPipeError:
        return 0
    except Exception as error:  # noqa: BLE001 reported to the other process
        return fail(out, "camera", error)


def run(out, camera, size, frame_us, exposure_us, gain):
    """Start the sensor and hand out its frames."""
    controls: dict = {"FrameDurationLimits": (frame_us, frame_us)}
    if exposure_us:
        controls.update(AeEnable=False, ExposureTime=exposure_us)
    if gain >= 0:
        controls["AnalogueGain"] = gain
    main_stream = {"size": size, "format": "YUV420"}
    camera.configure(camera.create_video_configuration(main=main_stream, controls=controls, buffer_count=4))
    camera.start()
    while True:
        request = camera.capture_request()
        try:
            grey = request.make_array("main")[: size[1]]
            stamp_ns = request.get_metadata()["SensorTimestamp"]
            data = grey.tobytes()
        finally:
            request.release()
        write(out, MAGIC + FRAME.pack(stamp_ns, size[1], len(data) // size[1]) + data)


def fail(out, where, error):
    """Say what went wrong; the exit code."""
    refusal = {
        "where": where,
        "kind": type(error).__name__,
        "text": " ".join(str(error).split())[:200],
        "missing": (error.name or "") if isinstance(error, ModuleNotFoundError) else "",
    }
    data = json.dumps(refusal).encode()
    write(out, FAULT + LENGTH.pack(len(data)) + data)
    return 1


def write(out, data):
    """All of it, however little the pipe takes at once."""
    view = memoryview(data)
    while view:
        view = view[out.write(view) :]


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
