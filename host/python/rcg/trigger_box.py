"""The trigger box, which fires projector and camera."""

import json
from collections.abc import Sequence
from enum import IntFlag
from typing import Any, Literal, Self

import numpy as np
from numpy.typing import NDArray

from . import _rcg
from .options import whole

RECORD = np.dtype(
    [
        ("step", np.uint64),
        ("trigger_ticks", np.uint64),
        ("strobe_delay_ticks", np.float64),
        ("strobe_width_ticks", np.float64),
        ("flags", np.uint8),
    ]
)


class Flag(IntFlag):
    """What is to be said of a step."""

    MISSED = 1
    """The step fired CAM but the camera did not expose."""
    DOUBLE = 2
    """The camera exposed more than once."""
    NO_TRIGGER = 4
    """The step had no CAM pulse."""
    OVERRUN = 8
    """The exposure still went on when the next trigger came or the run ended; its end is not known."""
    SYNC_MISSED = 16
    """At least one edge of SYNC did not come before this step, or during it."""
    SYNC_EXTRA = 32
    """SYNC had an edge more than its period allows."""


class TriggerBox:
    """A trigger box at a serial port.

    ``port`` is its name (``/dev/ttyACM0``, ``COM3``), ``auto`` for the only one on USB, or ``sim`` for the simulated one, whose time is
    virtual. ``rig`` says what times are where a schedule leaves them open. One thread talks to the box at a time, others wait; Ctrl-C ends a
    run at once. It is a context manager that closes the connection.

    Raises ``ValueError`` if there is no such port, ``RuntimeError`` if what is there does not answer.

    >>> with TriggerBox("sim") as box:
    ...     records = box.run(steps=3, exposures=[1e-3], cam_at=2e-3, period=100e-3)
    ...     milliseconds = records["trigger_ticks"] / box.info()["clock_hz"] * 1e3
    >>> milliseconds
    array([  2., 102., 202.])
    """

    def __init__(self, port: str = "auto", *, rig: str = "rcg-3") -> None:
        self._box = _rcg.TriggerBox(port, rig)

    def info(self) -> dict[str, Any]:
        """What it is and can do: ``port``, ``protocol``, ``firmware``, ``clock_hz`` (ticks in a second), ``max_steps``, ``max_words``,
        ``shortest_pulse_ticks``, ``shortest_pulse_with_sync_ticks``, ``longest_period_s``."""
        return json.loads(self._box.info())

    def status(self) -> dict[str, Any]:
        """How things stand: ``state``, ``run``, ``steps_done``, ``fault``, ``uptime_s``, and what was counted since it was switched on."""
        return json.loads(self._box.status())

    def abort(self) -> dict[str, Any]:
        """Ends a run at once; the lines rest then. Answers as :meth:`status`."""
        return json.loads(self._box.abort())

    def run(
        self,
        *,
        steps: int,
        exposures: Sequence[float | str] = (),
        period: float | str | None = None,
        cam_at: float | str | None = None,
        proj_width: float | str | None = None,
        stream: bool = False,
        start_on_sync: bool = False,
        each_on_sync: bool = False,
        sync_timeout: float | str | None = None,
        dead_man: float | str | None = None,
        active_low: Sequence[Literal["proj", "cam", "sync", "strobe"]] = (),
    ) -> NDArray[np.void]:
        """Fires ``steps`` steps and waits for the end; their records [steps].

        Times are seconds, or texts with their unit (``"33.3ms"``, ``"3ticks"``). ``exposures`` are the lengths of the CAM pulse, which take
        turns; ``cam_at`` its leading edge from the start of the step, ``proj_width`` the length of the PROJ pulse, which begins the step,
        ``period`` that of a step; what is left out comes from the rig. ``stream`` sends steps while others play, instead of a table
        beforehand. ``start_on_sync`` and ``each_on_sync`` wait for edges of SYNC, at most ``sync_timeout``. The box aborts if this program is
        silent for ``dead_man`` (0 for never). Lines that are ``active_low`` rest high.

        Records have ``step`` (from 0), ``trigger_ticks`` (from the start of the run), ``strobe_delay_ticks`` (from the trigger) and
        ``strobe_width_ticks`` (NaN where STROBE stayed at rest), ``flags`` (:class:`Flag`).

        Raises ``ValueError`` for what the box cannot make, ``RuntimeError`` for a run that ends with a fault.
        """
        schedule = {
            "steps": whole("steps", steps, 1, 2**32 - 1),
            "exposures": [_span("exposures", time) for time in exposures],
            "period": _span("period", period),
            "cam_at": _span("cam_at", cam_at),
            "proj_width": _span("proj_width", proj_width),
            "stream": stream,
            "start_on_sync": start_on_sync,
            "each_on_sync": each_on_sync,
            "sync_timeout": _span("sync_timeout", sync_timeout),
            "dead_man": _span("dead_man", dead_man),
            "active_low": list(active_low),
        }
        columns = self._box.run(json.dumps(schedule))
        records = np.empty(len(columns[0]), dtype=RECORD)
        for name, column in zip(RECORD.names, columns, strict=True):
            records[name] = column
        return records

    def close(self) -> None:
        """Ends the connection; what else is called then is a ``ValueError``."""
        self._box.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def _span(name: str, time: float | str | None) -> str | None:
    """A time with its unit."""
    if time is None or isinstance(time, str):
        return time
    return f"{float(time)!r}s"
