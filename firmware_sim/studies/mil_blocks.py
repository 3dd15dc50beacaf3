"""The wander-azimuth navigator as a block diagram: attitude, velocity and position as sampled blocks, wired.

Each block makes one step of its own: what it gives to the others in a step follows from its states at the start of
that step. Equations as in docs/navigation.md, written once more as a diagram has them, in float64.
"""

from __future__ import annotations

from math import asin, atan2, hypot, sqrt

import numpy as np

from firmware_sim.plant.earth import EARTH_RATE_RADPS, ECCENTRICITY2, SEMI_MAJOR_M
from firmware_sim.plant.source import Floats, Initial
from firmware_sim.studies import quadrants
from firmware_sim.studies.blocks import Diagram, Port, SampledBlock, Signals
from firmware_sim.studies.plain_navigator import attitude_matrix, rotation_matrix
from firmware_sim.studies.plain_wander import earth_to_level

SEEN = ("attitude.angles", "velocity.velocity", "position.place")


class RelativeRate(SampledBlock):
    """The body's rate against the platform: w_pb = w_ib - T^T w_ip, with w_ip = w_ie + w_ep."""

    inputs = (Port("gyro", 3, True), Port("T", 9, True), Port("w_ie", 3, True), Port("w_ep", 3, True))
    outputs = (Port("w_pb", 3),)

    def output(self, state: Floats, signals: Signals) -> dict[str, Floats]:
        platform = signals["w_ie"] + signals["w_ep"]
        return {"w_pb": signals["gyro"] - _matrix(signals["T"]).T @ platform}


class Attitude(SampledBlock):
    """Attitude from the rate against the platform.

    States: the rotation vector of the platform to the body, of at most half a turn. Parameters: the quaternion of the
    start, scalar first. Outputs: pitch, roll and azimuth against the platform (rad), and T = C_pb by rows.
    """

    states = 3
    inputs = (Port("w_pb", 3),)
    outputs = (Port("angles", 3), Port("T", 9))
    parameters = ("q0", "q1", "q2", "q3")

    def initial_state(self) -> Floats:
        return vector_of_quaternion(self.values / np.linalg.norm(self.values))

    def output(self, state: Floats, signals: Signals) -> dict[str, Floats]:
        T = matrix_of_quaternion(quaternion_of_vector(state))
        pitch = asin(max(-1.0, min(1.0, float(T[2, 1]))))
        roll = quadrants.roll_rad(float(T[2, 0]), float(T[2, 2]))
        azimuth = quadrants.azimuth_rad(float(T[0, 1]), float(T[1, 1]))
        return {"angles": np.array([pitch, roll, azimuth]), "T": T.ravel()}

    def update(self, state: Floats, signals: Signals) -> Floats:
        turn = quaternion_of_vector(self.sample_time_s * signals["w_pb"])
        return vector_of_quaternion(product(quaternion_of_vector(state), turn))


class SpecificForce(SampledBlock):
    """Specific force in the platform: f_p = T (f + (h/2) w_pb x f), with T of the start and f the mean of the step."""

    inputs = (Port("acc", 3, True), Port("w_pb", 3, True), Port("T", 9, True))
    outputs = (Port("f_p", 3),)

    def output(self, state: Floats, signals: Signals) -> dict[str, Floats]:
        force = signals["acc"] + 0.5 * self.sample_time_s * np.cross(signals["w_pb"], signals["acc"])
        return {"f_p": _matrix(signals["T"]) @ force}


class Velocity(SampledBlock):
    """Velocity over ground: dV/dt = f_p - (2 w_ie + w_ep) x V + g.

    States: Vx and Vy in the platform; the third component is the external climb rate. Parameters: both at the start.
    """

    states = 2
    inputs = (Port("f_p", 3), Port("w_ie", 3), Port("w_ep", 3), Port("climb", 1, True))
    outputs = (Port("velocity", 3),)
    parameters = ("vx0", "vy0")

    def initial_state(self) -> Floats:
        return self.values.copy()

    def output(self, state: Floats, signals: Signals) -> dict[str, Floats]:
        return {"velocity": np.array([state[0], state[1], signals["climb"][0]])}

    def update(self, state: Floats, signals: Signals) -> Floats:
        velocity = np.array([state[0], state[1], signals["climb"][0]])
        coriolis = np.cross(2.0 * signals["w_ie"] + signals["w_ep"], velocity)
        return state + self.sample_time_s * (signals["f_p"] - coriolis)[:2]


class Position(SampledBlock):
    """Position matrix: dC/dt = -[w_ep x] C.

    States: C = C_pe by rows. Parameters: latitude, longitude and wander angle of the start (rad). Outputs: latitude,
    longitude and wander angle; Earth's rate and the transport rate in the platform.
    """

    states = 9
    inputs = (Port("velocity", 3, True), Port("height", 1, True))
    outputs = (Port("place", 3), Port("w_ie", 3), Port("w_ep", 3))
    parameters = ("lat0", "lon0", "wander0")

    def initial_state(self) -> Floats:
        lat, lon, wander = (float(value) for value in self.values)
        return (rotation_matrix(np.array([[0.0, 0.0, -wander]]))[0] @ earth_to_level(lat, lon)).ravel()

    def output(self, state: Floats, signals: Signals) -> dict[str, Floats]:
        C = _matrix(state)
        place = np.array([
            atan2(C[2, 2], hypot(C[0, 2], C[1, 2])),
            quadrants.longitude_rad(float(C[2, 0]), float(C[2, 1])),
            quadrants.half_turn_angle(float(C[0, 2]), float(C[1, 2])),
        ])  # fmt: skip
        w_ep = transport_rate(C[:, 2], signals["velocity"], float(signals["height"][0]))
        return {"place": place, "w_ie": EARTH_RATE_RADPS * C[:, 2], "w_ep": w_ep}

    def update(self, state: Floats, signals: Signals) -> Floats:
        C = _matrix(state)
        w_ep = transport_rate(C[:, 2], signals["velocity"], float(signals["height"][0]))
        return (rotation_matrix(-self.sample_time_s * w_ep[None])[0] @ C).ravel()


def navigator_diagram(initial: Initial, sample_time_s: float) -> Diagram:
    """The blocks of a navigator that starts in a state, wired; sources gyro, acc (3), climb and height (1)."""
    diagram = Diagram(sample_time_s, [Port("gyro", 3), Port("acc", 3), Port("climb", 1), Port("height", 1)])
    start = attitude_matrix(initial.pitch_rad, initial.roll_rad, initial.azimuth_rad)
    diagram.add(RelativeRate("rate", sample_time_s))
    diagram.add(Attitude("attitude", sample_time_s, quaternion_of_matrix(start).tolist()))
    diagram.add(SpecificForce("force", sample_time_s))
    diagram.add(Velocity("velocity", sample_time_s, initial.vel_t_mps[:2]))
    diagram.add(Position("position", sample_time_s, (initial.lat_rad, initial.lon_rad, 0.0)))
    for start_of_wire, end in (
        ("gyro", "rate.gyro"),
        ("attitude.T", "rate.T"),
        ("position.w_ie", "rate.w_ie"),
        ("position.w_ep", "rate.w_ep"),
        ("rate.w_pb", "attitude.w_pb"),
        ("acc", "force.acc"),
        ("rate.w_pb", "force.w_pb"),
        ("attitude.T", "force.T"),
        ("force.f_p", "velocity.f_p"),
        ("position.w_ie", "velocity.w_ie"),
        ("position.w_ep", "velocity.w_ep"),
        ("climb", "velocity.climb"),
        ("velocity.velocity", "position.velocity"),
        ("height", "position.height"),
    ):
        diagram.wire(start_of_wire, end)
    return diagram


def transport_rate(axis: Floats, velocity_mps: Floats, height_m: float) -> Floats:
    """w_ep from the Earth's axis in the platform (C13, C23, C33): docs/navigation.md."""
    c13, c23, c33 = (float(value) for value in axis)
    x = 1.0 - ECCENTRICITY2 * c33 * c33
    across_m = SEMI_MAJOR_M / sqrt(x)
    across = 1.0 / (across_m + height_m)
    k = ECCENTRICITY2 * across_m / x * across / (across_m * (1.0 - ECCENTRICITY2) / x + height_m)
    vx, vy = float(velocity_mps[0]), float(velocity_mps[1])
    return np.array([
        -vx * k * c13 * c23 - vy * (across + k * c23 * c23),
        vx * (across + k * c13 * c13) + vy * k * c13 * c23,
        0.0,
    ])  # fmt: skip


def product(p: Floats, q: Floats) -> Floats:
    """Hamilton's product p q of quaternions, scalar first."""
    vector = p[0] * q[1:] + q[0] * p[1:] + np.cross(p[1:], q[1:])
    return np.array([p[0] * q[0] - p[1:] @ q[1:], *vector])


def quaternion_of_vector(vector: Floats) -> Floats:
    """The quaternion of a rotation vector."""
    half = 0.5 * float(np.linalg.norm(vector))
    # sin(half)/half has no digits to lose near zero; at zero it is one.
    return np.array([np.cos(half), *(0.5 * np.sinc(half / np.pi) * vector)])


def vector_of_quaternion(q: Floats) -> Floats:
    """The rotation vector, of at most half a turn, of a unit quaternion."""
    length = float(np.linalg.norm(q[1:]))
    if length == 0.0:
        return np.zeros(3)
    q = q if q[0] >= 0.0 else -q
    return np.asarray(2.0 * atan2(length, float(q[0])) / length * q[1:], dtype=np.float64)


def matrix_of_quaternion(q: Floats) -> Floats:
    """C_pb of a unit quaternion, (3, 3)."""
    w, x, y, z = (float(value) for value in q)
    return np.array([
        [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
        [2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)],
        [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)],
    ])  # fmt: skip


def quaternion_of_matrix(T: Floats) -> Floats:
    """The unit quaternion of a rotation matrix, from its largest element (Shepperd, J. Guidance 1 (1978) 223)."""
    trace = float(np.trace(T))
    largest = int(np.argmax([trace, *np.diag(T)]))
    if largest == 0:
        q = np.array([1.0 + trace, T[2, 1] - T[1, 2], T[0, 2] - T[2, 0], T[1, 0] - T[0, 1]])
    else:
        i = largest - 1
        j, k = (i + 1) % 3, (i + 2) % 3
        q = np.empty(4)
        q[0] = T[k, j] - T[j, k]
        q[1 + i] = 1.0 + 2.0 * T[i, i] - trace
        q[1 + j], q[1 + k] = T[i, j] + T[j, i], T[i, k] + T[k, i]
    return np.asarray(q / np.linalg.norm(q), dtype=np.float64)


def _matrix(rows: Floats) -> Floats:
    return rows.reshape(3, 3)
