"""A stand-in for ArduCopter's SITL: speaks the JSON interface's packets exactly, and MAVLink like the real one.

Its flight controller closes the attitude loop with motor pulses alone and knows only what the physics answers.
"""

import json
import socket
import struct
import time
from collections.abc import Sequence

from drivers.samples import GRAVITY
from drivers.simulated.vehicle import quaternion
from drivers.simulated.vehicle.autopilot import SimulatedAutopilot
from drivers.simulated.vehicle.rotors import FORWARD, REACTION, RIGHT, QuadX
from drivers.simulated.vehicle.vehicle import AttitudeCommand, Multirotor, RotorCommand

RATE_HZ = 200
PATIENCE_S = 600.0


def servo_packet(count: int, pulses_us: Sequence[int], rate_hz: int = RATE_HZ, magic: int = 18458) -> bytes:
    """The bytes that SITL sends: uint16 magic, uint16 frame rate, uint32 frame count, uint16 pulses, little endian."""
    padded = [*pulses_us, *[0] * (16 - len(pulses_us))]
    return struct.pack("<HHI16H", magic, rate_hz, count, *padded)


class RemotePhysics(Multirotor):
    """A vehicle whose every step is a packet to the physics backend and an answer from it."""

    port: int
    exchange: socket.socket
    count: int
    frame: QuadX

    def connect(self, port: int) -> "RemotePhysics":
        """Use the backend at a UDP port."""
        self.port, self.count, self.frame = port, 0, QuadX()
        self.exchange = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.exchange.settimeout(0.5)
        return self

    def step(self, dt: float, command: AttitudeCommand | RotorCommand) -> None:
        assert isinstance(command, AttitudeCommand)
        self.count += 1
        packet = servo_packet(self.count, self._pulses(command))
        end = time.monotonic() + (PATIENCE_S if self.count == 1 else 1.0)
        while True:
            self.exchange.sendto(packet, ("127.0.0.1", self.port))
            try:
                state = json.loads(self.exchange.recv(4096))
                break
            except (TimeoutError, ConnectionError):
                if time.monotonic() > end:
                    return  # the backend has ended; a real SITL goes on asking
        self.position = tuple(state["position"])
        self.velocity = tuple(state["velocity"])
        self.attitude = tuple(state["quaternion"])
        self.rates = tuple(state["imu"]["gyro"])
        self.specific_force = tuple(state["imu"]["accel_body"])
        self.on_ground = state["rng_1"] <= self.airframe.leg_m + 0.005 and abs(self.velocity[2]) < 0.02

    def _pulses(self, command: AttitudeCommand) -> list[int]:
        """Attitude error -> rates -> angular acceleration -> thrust of each motor -> pulse."""
        if command.thrust <= 0.0:
            return [1000] * 4
        error = quaternion.multiply(quaternion.conjugate(self.attitude), command.attitude)
        gain = 2 * 6.0 * (1 if error[0] >= 0 else -1)
        spin = [min(max(14 * (gain * error[i + 1] - self.rates[i]), -60), 60) for i in range(3)]
        f = self.frame
        largest = GRAVITY / f.hover_share / 4
        pulses = []
        for i in range(4):
            thrust = command.thrust / 4
            thrust += -RIGHT[i] * spin[0] * f.gyration[0] / (4 * f.lever_m)
            thrust += FORWARD[i] * spin[1] * f.gyration[1] / (4 * f.lever_m)
            thrust += REACTION[i] * min(max(spin[2], -6), 6) * f.gyration[2] / (4 * f.yaw_lever_m)
            pulses.append(round(f.pulse(thrust / largest)))
        return pulses


class FakeSitl:
    """An ArduCopter of our own behind MAVLink on TCP, flying on the physics at a UDP port."""

    def __init__(self, physics_port: int) -> None:
        self.vehicle = RemotePhysics().connect(physics_port)
        self.autopilot = SimulatedAutopilot("tcp:127.0.0.1:0", self.vehicle, step_hz=RATE_HZ)
        self.connection = f"tcp:127.0.0.1:{self.autopilot.port}"

    def __enter__(self) -> "FakeSitl":
        self.autopilot.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.autopilot.stop()
        self.vehicle.exchange.close()
