"""A complementary filter: the roll of a vehicle from a gyro, which drifts, and accelerometers, which shake."""

from firmware_sim.kernels.language import Real, kernel
from firmware_sim.nav.elementary import add_two_word, arctangent2

STEP_S = 0.02
GAIN = STEP_S / 10.0  # the accelerometers' say, with a time constant of 10 s


@kernel
def roll_step(rate_radps: float, force_x_mps2: float, force_z_mps2: float, roll_rad: Real[2]) -> float:
    """One step of the filter; ``roll_rad`` is its state in two words, the result the rounded roll [rad]."""
    seen_rad = arctangent2(-force_x_mps2, force_z_mps2)
    change_rad = rate_radps * STEP_S + GAIN * (seen_rad - roll_rad[0])
    roll_rad[0], roll_rad[1] = add_two_word(roll_rad[0], roll_rad[1], change_rad)
    return roll_rad[0]
