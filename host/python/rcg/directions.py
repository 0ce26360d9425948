"""Directions: unit vectors and the angles that name them."""

import numpy as np
from numpy.typing import ArrayLike, NDArray


def from_degrees(theta: ArrayLike, phi: ArrayLike) -> NDArray[np.float64]:
    """Unit vectors of polar angles and azimuths in degrees.

    ``theta`` and ``phi`` are numbers or arrays that broadcast to a shape [...]; the answer is [..., 3] (x, y, z).

    >>> from_degrees(90, [0, 90]).round(12)
    array([[1., 0., 0.],
           [0., 1., 0.]])
    """
    theta, phi = np.broadcast_arrays(np.radians(_numbers("theta", theta)), np.radians(_numbers("phi", phi)))
    return np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], axis=-1)


def to_degrees(w: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Polar angles, 0 to 180, and azimuths, 0 to 360, in degrees of unit vectors ``w`` [..., 3].

    >>> [angle.item() for angle in to_degrees([0, 1, 0])]
    [90.0, 90.0]
    """
    x, y, z = np.moveaxis(vectors("w", w), -1, 0)
    return np.degrees(np.arctan2(np.hypot(x, y), z)), np.degrees(np.arctan2(y, x)) % 360


def vectors(name: str, w: ArrayLike) -> NDArray[np.float64]:
    """``w`` as numbers [..., 3]; ``ValueError`` that names ``name`` if it is none."""
    array = _numbers(name, w)
    if array.ndim == 0 or array.shape[-1] != 3:
        raise ValueError(f"{name}: expected vectors [..., 3], found an array {list(array.shape)}")
    return array


def _numbers(name: str, values: ArrayLike) -> NDArray[np.float64]:
    try:
        array = np.asarray(values)
    except ValueError as error:
        raise ValueError(f"{name}: expected an array of numbers, found rows of different lengths") from error
    if np.ma.is_masked(values):
        raise ValueError(f"{name}: expected an array of numbers, found a masked one")
    if array.dtype.kind not in "iuf":
        raise ValueError(f"{name}: expected an array of numbers, found one of {array.dtype}")
    return array.astype(np.float64, copy=False)
