"""Measuring on the virtual rig."""

import json
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from . import _rcg
from .clock import host, now
from .options import finite, whole

_GRIDS = ("theta-phi", "equal-solid-angle")


def measure(
    out: str | os.PathLike[str],
    *,
    resume: bool = False,
    target_db: float | None = None,
    budget: int | None = None,
    **options: Any,
) -> dict[str, Any]:
    """Measures a sample on the virtual rig, from the plan to the report, into the new directory ``out``.

    Takes the options of :func:`plan` and those that say who measures: ``operator`` and ``notes``. With ``resume`` a measurement that was
    interrupted goes on; options that are given must be those of before.

    With ``target_db`` or ``budget`` incident directions are chosen on the way, where the predicted error is largest, until the predicted
    PSNR of f·cosθi at exposure 1, clipped to 1, is ``target_db`` (dB), or so many patterns with light were captured. It starts from the
    ``grid``, if one is given, or else from 48 directions that are far apart.

    Answers with a summary: ``out``, ``evaluation`` (coverage, error, uncertainty), ``capture``, ``assembled`` and more. ``rcg.open(out)``
    is the result. Ctrl-C ends it where it is, and ``resume`` goes on from there.

    Raises ``ValueError`` for what cannot be measured so, ``OSError`` for what cannot be written, ``RuntimeError`` for what fails.
    """
    far = {"target_db": finite("target_db", target_db), "budget": whole("budget", budget, 0, 2**32 - 1)}
    return json.loads(_rcg.measure(Path(out), _asked(adaptive=far, **options), resume))


def plan(**options: Any) -> dict[str, Any]:
    """What a measurement would take: exposures, seconds on the instrument, bytes on disk, what bounds it.

    | option | means | default |
    |---|---|---|
    | ``rig`` | ``rcg-1``, ``rcg-1-16bit``, ``rcg-2``, ``rcg-3``, ``dmd`` or a file | ``rcg-3`` |
    | ``sample`` | what stands in the virtual rig, as :class:`rcg.Brdf` takes it | ``ward:brass`` |
    | ``step_deg`` | degrees between rings of incident directions, divides 90 | 3 |
    | ``grid`` | ``theta-phi``, ``equal-solid-angle``, a file of lines `θ φ`, or directions [N, 2] in degrees | ``theta-phi`` |
    | ``image_size`` | pixels a side of images and of the grid of outgoing directions | 96 |
    | ``exposure_s`` | seconds | found by a pilot capture |
    | ``brackets`` | exposures of each pattern: ``auto``, how many, or their times in milliseconds | 1 |
    | ``light`` | ``single``, ``multiplexed``, ``complement`` or ``auto`` | ``single`` |
    | ``spot_deg`` | opening of the cone that a pattern lights | that of the rig |
    | ``tilt`` | of the sample, degrees: (tilt, towards) or (tilt, towards, turn) | none |
    | ``lossless`` | whether every bit of f and σ is kept | f is rounded by at most σ/10 |
    | ``noise``, ``seed`` | of the virtual rig | True, 1 |
    | ``truth``, ``calibration`` | how the rig really is (a file), what was found of it (a directory) | as its file says |
    | ``sample_name``, ``sample_description``, ``reference`` | for the report; a known material to compare with | |

    >>> plan(rig="rcg-2", step_deg=15)["grid_directions"]
    144
    """
    return json.loads(_rcg.plan(_asked(**options)))


def _asked(
    *,
    adaptive: dict[str, Any] | None = None,
    rig: str | os.PathLike[str] | None = None,
    sample: str | os.PathLike[str] | None = None,
    step_deg: float | None = None,
    grid: str | os.PathLike[str] | ArrayLike | None = None,
    image_size: int | None = None,
    exposure_s: float | None = None,
    brackets: int | str | Sequence[float] | None = None,
    light: str | None = None,
    spot_deg: float | None = None,
    tilt: Sequence[float] | None = None,
    noise: bool | None = None,
    seed: int | None = None,
    truth: str | os.PathLike[str] | None = None,
    calibration: str | os.PathLike[str] | None = None,
    lossless: bool | None = None,
    sample_name: str | None = None,
    sample_description: str | None = None,
    reference: str | os.PathLike[str] | None = None,
    operator: str | None = None,
    notes: Sequence[str] = (),
) -> str:
    """The options as the compiled part reads them."""
    step_deg, exposure_s = finite("step_deg", step_deg), finite("exposure_s", exposure_s)
    if exposure_s is not None and brackets is not None:
        raise ValueError(f"exposure_s: expected none beside brackets, which say how long exposures are, found {exposure_s}")
    directions, grid = _grid(grid, step_deg)
    words = brackets if isinstance(brackets, (str, int, type(None))) else ",".join(map(str, brackets))
    request = {
        "grid": grid,
        "image_size": whole("image_size", image_size, 0, 2**32 - 1),
        "exposure_s": exposure_s,
        "brackets": None if words is None else str(words),
        "light": light,
        "spot_deg": finite("spot_deg", spot_deg),
        "tilt": None if tilt is None else ":".join(map(str, tilt)),
        "lossless": lossless,
        "sample_name": sample_name,
        "sample_description": sample_description,
        "reference": _path(reference),
    }
    virtual = {"sample": _path(sample), "truth": _path(truth), "noise": noise, "seed": whole("seed", seed, 0, 2**64 - 1)}
    asked = {
        "rig": _path(rig) or os.environ.get("RCG_RIG", "rcg-3"),
        "calibration": _path(calibration),
        "directions": directions,
        "request": _given(request),
        "virtual": _given(virtual),
        "adaptive": _given(adaptive or {}) or None,
        "session": {"began": now(), "host": host(), "operator": operator, "notes": list(notes)},
    }
    return json.dumps(asked)


def _grid(grid: Any, step_deg: float | None) -> tuple[str | None, dict[str, Any] | None]:
    """A file of directions, or the grid as a plan has it."""
    if grid is None or isinstance(grid, str) and grid in _GRIDS:
        kind = grid or "theta-phi"
        default = grid is None and step_deg is None
        return None, None if default else {"kind": kind, "step_deg": 3.0 if step_deg is None else step_deg}
    if step_deg is not None:
        raise ValueError(f"step_deg: expected none with a list of directions, found {step_deg}")
    if isinstance(grid, (str, os.PathLike)):
        return os.fsdecode(grid), None
    directions = np.asarray(grid, dtype=np.float64)
    if directions.ndim != 2 or directions.shape[1] != 2 or not np.isfinite(directions).all():
        raise ValueError(f"grid: expected finite angles θ, φ [N, 2] in degrees, found an array {list(directions.shape)}")
    return None, {"kind": "list", "directions_deg": directions.tolist()}


def _path(path: str | os.PathLike[str] | None) -> str | None:
    return None if path is None else os.fsdecode(path)


def _given(options: dict[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in options.items() if value is not None}
