"""A measurement as a dataset of xarray."""

import os
from pathlib import Path

import numpy as np
import xarray


def open(path: str | os.PathLike[str], **options) -> xarray.Dataset:
    """The ``brdf.zarr`` at ``path``, or that of the measurement in the directory ``path``, lazily: chunks are read when they are asked for.

    | variable | axes | content |
    |---|---|---|
    | ``f`` | incident, y, x, channel | BRDF in 1/sr, without the cosine; NaN where there is none |
    | ``sigma`` | incident, y, x, channel | its standard uncertainty (k = 1), 1/sr |
    | ``provenance`` | incident, y, x | where it is from: codes, whose words stand in ``flag_meanings`` |
    | ``incident_theta``, ``incident_phi`` | incident | directions of light, degrees |
    | ``outgoing_theta``, ``outgoing_phi`` | y, x | directions of view, degrees; NaN beyond the horizon |
    | ``incident_reason``, ``outgoing_reason`` | incident; y, x | why nothing was measured there: codes of :class:`rcg.Reason` |

    It is ``xarray.open_zarr(path, consolidated=False)`` with the two coordinates ``outgoing_theta`` and ``outgoing_phi``; ``options`` go there
    (``chunks=None`` for arrays of NumPy instead of dask's).

    Raises ``ValueError`` if there is no such dataset.

    >>> open("nowhere")
    Traceback (most recent call last):
    ValueError: nowhere: expected a brdf.zarr or the directory of a measurement, found none
    """
    path = Path(path)
    own = path / "brdf.zarr"
    path = own if own.is_dir() else path
    if not (path / "zarr.json").is_file():
        raise ValueError(f"{path}: expected a brdf.zarr or the directory of a measurement, found none")
    dataset = xarray.open_zarr(path, consolidated=False, **options)
    found = dataset.attrs.get("rcg_format", "another group of Zarr")
    if found != "brdf":
        raise ValueError(f"{path}, rcg_format: expected brdf, found {found}")
    theta, phi = _outgoing(dataset.sizes["y"], dataset.attrs.get("azimuth_deg", 0.0))
    names = {
        "outgoing_theta": (("y", "x"), theta, {"units": "degree", "long_name": "polar angle of view"}),
        "outgoing_phi": (("y", "x"), phi, {"units": "degree", "long_name": "azimuth of view"}),
    }
    return dataset.assign_coords(names)


def _outgoing(size: int, azimuth_deg: float) -> tuple[np.ndarray, np.ndarray]:
    """Directions of the cells [y, x] in degrees: Lambert's equal-area disk, x + iy = √2·sin(θ/2)·exp(iφ), turned by the azimuth."""
    centres = (np.arange(size) + 0.5) / size * 2 - 1
    x, y = np.meshgrid(centres, centres)
    radius = np.hypot(x, y)
    radius = np.where(radius < 1, radius, np.nan)
    phi = (np.degrees(np.arctan2(y, x)) - azimuth_deg) % 360
    return np.degrees(2 * np.arcsin(radius / np.sqrt(2))), np.where(np.isnan(radius), np.nan, phi)
