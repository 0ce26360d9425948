"""Values of a BRDF at arrays of directions."""

import os
from collections.abc import Callable
from enum import IntEnum
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _rcg
from .directions import vectors


class Reason(IntEnum):
    """Why there is no value. The words are those of `rcg value`; 1 to 6 are the codes of ``incident_reason`` and ``outgoing_reason`` in a
    ``brdf.zarr``.

    >>> Reason(5).words
    'below horizon'
    """

    NONE = 0
    """There is a value."""
    HOLE = 1
    """The light would go through the hole of the mirror."""
    BEYOND_RIM = 2
    """The light would pass below the mirror's rim."""
    OUTSIDE_IMAGE = 3
    """No pixel of the camera or the projector looks there."""
    OCCLUDED = 4
    """The wire that holds the sample is in the way."""
    BELOW_HORIZON = 5
    """A direction is at or below the horizon: f is not defined there."""
    OFF_SAMPLE = 6
    """What the camera sees there is not, or not surely, the sample."""
    SATURATED = 7
    """The camera saturated there."""
    UNKNOWN = 8
    """The file has none."""

    @property
    def words(self) -> str:
        """The reason in words."""
        return "no value in the file" if self is Reason.UNKNOWN else self.name.lower().replace("_", " ")


class Brdf:
    """A BRDF: a measurement, a file of another program, or a model.

    ``source`` is what the command takes for a BRDF: a ``brdf.zarr`` or the directory of a measurement; a file of RGL, MERL, SSDD, Klems,
    Zemax, BiRD or ``rcg export --to npy``; a certificate; or a model such as ``ward:brass``, ``satin`` or ``lambert:0.5``, which ``@30``
    turns by 30°.

    Between the captured directions of a ``brdf.zarr`` ``interpolation`` decides: ``blended`` follows highlights (as `rcg value`),
    ``half-vector`` keeps the half vector, ``direct`` is linear in all angles and three times as fast, but cross-fades highlights between
    images that are far apart. Its values are held in memory, 20 bytes for three channels, unless ``in_memory`` is false. All methods may be called from
    several threads at a time; they let other threads of Python run, and Ctrl-C ends them.

    Raises ``ValueError`` for a source that is none, ``OSError`` for a file that cannot be read.

    >>> brdf = Brdf("lambert:0.5")
    >>> brdf.eval([[0, 0, 1]], [[0.6, 0, 0.8]]).round(4)
    array([[0.1592, 0.1592, 0.1592]])
    >>> Brdf("ward:gold")
    Traceback (most recent call last):
    ValueError: sample 'ward:gold', arguments: expected a leading preset (brass) or rd=, rs=, ax=, ay=, found 'gold'
    """

    def __init__(
        self,
        source: str | os.PathLike[str],
        *,
        interpolation: Literal["blended", "half-vector", "direct"] = "blended",
        in_memory: bool = True,
    ) -> None:
        self._source = os.fsdecode(source)
        self._brdf = _rcg.Brdf(self._source, interpolation, in_memory)

    @property
    def channels(self) -> int:
        """Colour channels: 3 (red, green, blue, or what the rig names as bands), or 1 of a camera without colours."""
        return self._brdf.channels

    def eval(self, wi: ArrayLike, wo: ArrayLike) -> NDArray[np.float64]:
        """f in 1/sr, without the cosine; NaN where there is no value.

        ``wi`` and ``wo`` are unit vectors [..., 3] (incident, outgoing), both away from the surface, that broadcast to a common shape;
        the answer is [..., channels]. Numbers of any type and layout serve; float64 in C order is not copied as a whole.

        Raises ``ValueError`` for other shapes and for what is no unit vector (to 1e-5).
        """
        return self._answer(self._brdf.eval, self.channels, wi, wo)

    def sigma(self, wi: ArrayLike, wo: ArrayLike) -> NDArray[np.float64]:
        """Standard uncertainty (k = 1) of f in 1/sr, interpolation between captured directions included; NaN where there is no value.

        Takes and answers as :meth:`eval`. Raises ``ValueError`` too where the source states none: it is no ``brdf.zarr``.
        """
        return self._answer(self._brdf.sigma, self.channels, wi, wo)

    def reason(self, wi: ArrayLike, wo: ArrayLike) -> NDArray[np.uint8]:
        """Codes of :class:`Reason`, why there is no value; 0 where there is one.

        Takes as :meth:`eval`; the answer is [...].

        >>> brdf = Brdf("ward:brass")
        >>> [Reason(code).words for code in brdf.reason([0, 0, 1], [[0, 0, 1], [1, 0, 0]])]
        ['none', 'below horizon']
        """
        return self._answer(self._brdf.reason, 1, wi, wo)[..., 0]

    def _answer(self, ask: Callable[..., NDArray], columns: int, wi: ArrayLike, wo: ArrayLike) -> NDArray:
        wi, wo = vectors("wi", wi), vectors("wo", wo)
        try:
            shape = np.broadcast_shapes(wi.shape, wo.shape)
        except ValueError as error:
            found = f"{list(wi.shape)} and {list(wo.shape)}"
            raise ValueError(f"wi, wo: expected shapes that broadcast, found {found}") from error
        flat = [np.ascontiguousarray(np.broadcast_to(w, shape)).reshape(-1) for w in (wi, wo)]
        return ask(*flat).reshape(*shape[:-1], columns)

    def __repr__(self) -> str:
        return f"rcg.Brdf({self._source!r})"
