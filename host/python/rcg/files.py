"""Files: what they are, and other programs' formats."""

import json
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Literal

from . import _rcg
from .clock import now

Source = str | os.PathLike[str]
Format = Literal["bsdf", "merl", "ssdd", "klems", "zemax", "bird", "npy", "csv"]


def info(source: Source) -> dict[str, Any]:
    """What a file or a model is: format, facts, range of f, missing values, symmetries, reciprocity, directional albedo, warnings.

    ``source`` is as :class:`rcg.Brdf` takes it. Symmetries (``turned``, ``mirrored``, ``exchanged``) are mean differences of luminance over
    its mean; 0 is perfect.

    >>> info("lambert:0.5")["turned"] < 1e-6
    True
    """
    return json.loads(_rcg.info(os.fsdecode(source)))


def export(
    source: Source,
    *,
    to: Format | None = None,
    out: Source,
    step_deg: float | None = None,
    resolution: int | None = None,
    incident_deg: tuple[float, float] | None = None,
    zeros: bool = False,
    table: Literal["dense", "compact"] | None = None,
) -> dict[str, Any]:
    """Writes ``source`` (as :class:`rcg.Brdf` takes it) as the file ``out`` of another program and reads it back.

    ``to`` is the format; without it the end of ``out`` says it (``.bsdf`` is that of Mitsuba). ``step_deg``, 0.5 to 45, is the step of the
    table's angles, ``resolution`` the points along each side of a ``.bsdf``'s table, ``incident_deg`` the one incident direction (θ, φ) of a
    ``.csv``, ``table`` how a ``.bsdf`` tabulates half vectors (``compact`` where that is smaller and as good, if nobody says). A format without missing values takes none, unless ``zeros`` writes 0.

    Answers with ``bytes``, ``pairs``, ``missing`` (share), ``table`` (of a ``.bsdf``: which it is, and why), ``round_trip`` (how far the file is from its source) and ``warnings``. The file
    appears whole or not at all.

    Raises ``ValueError`` for what the format cannot carry, ``OSError`` for a file that cannot be written.
    """
    path = Path(out)
    if to is None:
        ending = path.suffix.lower().removeprefix(".")
        known = [name for name, endings in _rcg.formats() if ending in endings]
        if not known:
            raise ValueError(f"{path}: expected a file name that ends as one of a known format, or `to`, found {path.name}")
        to = known[0]
    written = _rcg.export(os.fsdecode(source), to, path, step_deg, resolution, incident_deg, zeros, table, now())
    return json.loads(written)


def fill(
    brdfs: Source | Sequence[Source],
    *,
    out: Source,
    without: Sequence[Literal["reciprocity", "wire", "model"]] = (),
    any_scale: bool = False,
) -> dict[str, Any]:
    """Fills what a capture does not reach, and writes the ``brdf.zarr`` ``out``: from captures of the same sample at other tilts, from the
    exchanged pairs of directions, from both sides of the wire, and from a fitted model; as `rcg fill`.

    ``brdfs`` is a measurement or several, the first of which the others are brought to. Every value says where it comes from
    (``provenance``). Answers with ``shares`` of each origin, the ``model`` and ``warnings``.
    """
    one = isinstance(brdfs, (str, os.PathLike))
    paths = [Path(path) for path in ([brdfs] if one else brdfs)]
    return json.loads(_rcg.fill(paths, Path(out), list(without), any_scale))
