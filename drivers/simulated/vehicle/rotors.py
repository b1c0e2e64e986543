"""From motor pulses to thrust and torque: a quadrotor in X layout with ArduPilot's motor order and thrust curve."""

from collections.abc import Sequence
from dataclasses import dataclass

from drivers.samples import GRAVITY
from drivers.simulated.vehicle.vehicle import RotorCommand

# ArduCopter's motors 1 to 4: front right, rear left (both turn counterclockwise), front left, rear right (clockwise).
FORWARD = (1, -1, 1, -1)
RIGHT = (1, -1, -1, 1)
REACTION = (1, 1, -1, -1)
"""Sign of the yaw torque that a rotor leaves on the body: clockwise from above is positive."""


@dataclass(frozen=True, slots=True)
class QuadX:
    """A quadrotor of some 1.5 kg; the curve is what ArduCopter's default parameters undo."""

    pulse_low_us: float = 1000.0
    pulse_high_us: float = 2000.0
    spin_low: float = 0.15
    """MOT_SPIN_MIN."""
    spin_high: float = 0.95
    """MOT_SPIN_MAX."""
    thrust_expo: float = 0.65
    """MOT_THST_EXPO."""
    hover_share: float = 0.35
    """Thrust of hover over the largest (MOT_THST_HOVER)."""
    lever_m: float = 0.127
    """Distance of each rotor to the roll and to the pitch axis."""
    yaw_lever_m: float = 0.02
    """A rotor's reaction torque over its thrust."""
    gyration: tuple[float, float, float] = (0.010, 0.010, 0.018)
    """Moments of inertia over mass, m^2."""

    def command(self, pulses_us: Sequence[float]) -> RotorCommand:
        """What the rotors do at four pulse widths; pulses below the range stop them."""
        largest = GRAVITY / self.hover_share / 4
        thrusts = [largest * self._thrust(p) for p in pulses_us[:4]]
        roll = -self.lever_m * sum(r * t for r, t in zip(RIGHT, thrusts, strict=True))
        pitch = self.lever_m * sum(f * t for f, t in zip(FORWARD, thrusts, strict=True))
        yaw = self.yaw_lever_m * sum(s * t for s, t in zip(REACTION, thrusts, strict=True))
        i = self.gyration
        return RotorCommand(sum(thrusts), (roll / i[0], pitch / i[1], yaw / i[2]))

    def pulse(self, share: float) -> float:
        """The pulse width that gives a share of a rotor's largest thrust: the inverse of the curve."""
        e = self.thrust_expo
        share = min(max(share, 0.0), 1.0)
        a = ((e - 1) + ((1 - e) ** 2 + 4 * e * share) ** 0.5) / (2 * e)
        output = self.spin_low + (self.spin_high - self.spin_low) * a
        return self.pulse_low_us + output * (self.pulse_high_us - self.pulse_low_us)

    def _thrust(self, pulse_us: float) -> float:
        """Share of the largest thrust at a pulse width."""
        output = (pulse_us - self.pulse_low_us) / (self.pulse_high_us - self.pulse_low_us)
        a = (output - self.spin_low) / (self.spin_high - self.spin_low)
        a = min(max(a, 0.0), 1.2)
        return (1 - self.thrust_expo) * a + self.thrust_expo * a * a
