"""A measurement as a dataset of xarray."""

import os
from pathlib import Path

import xarray


def open(path: str | os.PathLike[str], **options) -> xarray.Dataset:
    """The ``brdf.zarr`` at ``path``, or that of the measurement in the directory ``path``, lazily: chunks are read when they are asked for.

    | variable | axes | content |
    |---|---|---|
    | ``f`` | incident, y, x, channel | BRDF in 1/sr, without the cosine; NaN where there is none |
    | ``sigma`` | incident, y, x, channel | its standard uncertainty (k = 1), 1/sr |
    | ``provenance`` | incident, y, x | where it is from: codes, whose words stand in ``flag_meanings`` |
    | ``incident_theta``, ``incident_phi`` | incident | directions of light, degrees |
    | ``outgoing_theta``, ``outgoing_phi`` | y, x | directions of view, degrees |
    | ``incident_reason``, ``outgoing_reason`` | incident; y, x | why nothing was measured there: codes of :class:`rcg.Reason` |

    It is ``xarray.open_zarr(path, consolidated=False)``; ``options`` go there (``chunks=None`` for arrays of NumPy instead of dask's).

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
    if dataset.attrs.get("rcg_format") != "brdf":
        found = dataset.attrs.get("rcg_format", "another group of Zarr")
        raise ValueError(f"{path}, rcg_format: expected brdf, found {found}")
    return dataset
