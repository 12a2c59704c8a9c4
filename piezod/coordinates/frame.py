"""The frame of a stage: between its sensors, its user axes and its actuators."""

from typing import NamedTuple, TypeAlias

from piezod.coordinates.matrices import Matrix, Vector, inverse, product, times

Lags: TypeAlias = tuple[tuple[tuple[int, float, float], ...], ...]
"""For each actuator: the index of others that move it later, their share, and the lag in s."""


class Frame(NamedTuple):
    """The matrices of a stage, of one size. All methods are real-time safe.

    The displacement of an actuator is what its own sensor shows if the other actuators rest.
    """

    to_actuators: Matrix  #: User axes, less their offsets, to displacements of the actuators.
    to_user: Matrix  #: The inverse.
    from_sensors: Matrix  #: Sensors to displacements of the actuators.
    offsets: tuple[float, ...]  #: User axes where all actuators are at 0.

    def actuators(self, user: Vector) -> list[float]:
        """Return the displacements of the actuators at a point of the user axes."""
        return times(
            self.to_actuators,
            [value - offset for value, offset in zip(user, self.offsets, strict=True)],
        )

    def user(self, actuators: Vector) -> list[float]:
        """Return the point of the user axes at displacements of the actuators."""
        return [
            value + offset
            for value, offset in zip(times(self.to_user, actuators), self.offsets, strict=True)
        ]


def frame_of(
    actuators: Matrix,
    sensors: Matrix | None,
    coupling: Matrix,
    levers: Matrix,
    offsets: Vector,
) -> Frame | None:
    """Return the frame of a stage; None if a matrix is singular.

    Args:
        actuators: User axes to actuators, for actuators that do not move each other.
        sensors: Sensors to user axes; None if each sensor is at its actuator.
        coupling: What each sensor shows if one actuator moves by 1; its diagonal is 1.
        levers: User axes where they are measured to user axes at the point of the user.
        offsets: User axes where all actuators are at 0.
    """
    uncoupled, without_levers = inverse(coupling), inverse(levers)
    if uncoupled is None or without_levers is None:
        return None
    moved = product(uncoupled, actuators)
    to_actuators = product(moved, without_levers)
    to_user = inverse(to_actuators)
    if to_user is None:
        return None
    from_sensors = uncoupled if sensors is None else product(moved, sensors)
    return Frame(to_actuators, to_user, from_sensors, tuple(offsets))
