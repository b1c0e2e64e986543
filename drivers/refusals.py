"""Why an input is refused. One table: the only place of these codes and of what they mean."""

from enum import StrEnum

SECOND_GONE_S = 10.0
"""Silence after which a second vehicle has left the link: ten of its heartbeats."""


class RefusalCode(StrEnum):
    """Every reason to refuse a frame, a message or a row of a file."""

    BAD_PICTURE = "bad_picture"
    SIZE_CHANGED = "size_changed"
    IMAGE_SIZE = "image_size"
    REPEATED_STAMP = "repeated_stamp"
    BACKWARD_STAMP = "backward_stamp"
    PICTURE_REPEATED = "picture_repeated"
    UNDECODABLE_FRAME = "undecodable_frame"
    FRAME_WITHOUT_STAMP = "frame_without_stamp"
    VIDEO_ENDED = "video_ended"
    REPEATED_ROW = "repeated_row"
    UNREADABLE_ROW = "unreadable_row"
    GARBAGE = "garbage"
    BAD_CHECKSUM = "bad_checksum"
    CUT_OFF = "cut_off"
    EMPTY_FILE = "empty_file"
    UNDECODABLE = "undecodable"
    UNSIGNED = "unsigned"
    WRONG_SIGNATURE = "wrong_signature"
    REPLAYED = "replayed"
    SEQUENCE = "sequence"
    REPEATED_FRAME = "repeated_frame"
    SECOND_SENDER = "second_sender"
    SECOND_VEHICLE = "second_vehicle"
    FOREIGN_SYSTEM = "foreign_system"
    FOREIGN_COMPONENT = "foreign_component"
    OWN_ADDRESS = "own_address"
    OUR_NAME = "our_name"
    NOT_FINITE = "not_finite"
    NOT_A_ROTATION = "not_a_rotation"
    REPEATED_MESSAGE = "repeated_message"
    BOOT_TIME_FELL = "boot_time_fell"
    OUT_OF_ORDER = "out_of_order"

    @property
    def words(self) -> str:
        """The code as a person reads it."""
        return self.replace("_", " ")


REFUSAL_MEANING = {
    RefusalCode.BAD_PICTURE: "the image is empty, or not one plane of bytes",
    RefusalCode.SIZE_CHANGED: "the image has another size than the camera's images so far",
    RefusalCode.IMAGE_SIZE: "the image has another size than the calibration or the recording",
    RefusalCode.REPEATED_STAMP: "the frame has the time stamp of the frame before",
    RefusalCode.BACKWARD_STAMP: "the frame's time stamp is older than that of the frame before",
    RefusalCode.PICTURE_REPEATED: "the image equals the one before bit for bit",
    RefusalCode.UNDECODABLE_FRAME: "the recorded image cannot be decoded",
    RefusalCode.FRAME_WITHOUT_STAMP: "the recorded frame has no row in frames.csv",
    RefusalCode.VIDEO_ENDED: "frames.csv has a row and the video no frame",
    RefusalCode.REPEATED_ROW: "frames.csv has the frame's number twice",
    RefusalCode.UNREADABLE_ROW: "the row of frames.csv has no valid number and time",
    RefusalCode.GARBAGE: "the bytes are no MAVLink frame",
    RefusalCode.BAD_CHECKSUM: "the MAVLink frame's checksum is wrong",
    RefusalCode.CUT_OFF: "the recording ends within a frame",
    RefusalCode.EMPTY_FILE: "the recording is empty",
    RefusalCode.UNDECODABLE: "the MAVLink frame cannot be decoded",
    RefusalCode.UNSIGNED: "the frame is not signed although mavlink.signing_key is set",
    RefusalCode.WRONG_SIGNATURE: "the frame is signed with another key",
    RefusalCode.REPLAYED: "the signed frame is not newer than those already received",
    RefusalCode.SEQUENCE: "the frame's sequence number does not continue its sender's",
    RefusalCode.REPEATED_FRAME: "the frame has the sequence number of the frame before",
    RefusalCode.SECOND_SENDER: "the frame has the vehicle's ids and comes from another address",
    RefusalCode.SECOND_VEHICLE: "a second autopilot is on the link and vehicle.system_id is not set",
    RefusalCode.FOREIGN_SYSTEM: "the message is of another system than the vehicle",
    RefusalCode.FOREIGN_COMPONENT: "the message is of another component than the autopilot",
    RefusalCode.OWN_ADDRESS: "the frame comes with this program's own ids",
    RefusalCode.OUR_NAME: "a forwarded program sent a frame with this program's ids",
    RefusalCode.NOT_FINITE: "the message has a value that is not finite",
    RefusalCode.NOT_A_ROTATION: "the attitude's quaternion is not of unit length",
    RefusalCode.REPEATED_MESSAGE: "the message has the boot time of the one before",
    RefusalCode.BOOT_TIME_FELL: "the message's boot time fell back without a reboot",
    RefusalCode.OUT_OF_ORDER: "the message is older than one already taken",
}
