"""The trigger box as a device of ophyd-async, which Bluesky plans trigger and read.

    pip install "ophyd-async>=0.21,<0.22"
    python ophyd_trigger_box.py [PORT]
"""

import asyncio
import sys

import bluesky.plans as bp
import numpy as np
from bluesky.run_engine import RunEngine
from ophyd_async.core import (
    AsyncStatus,
    StandardReadable,
    init_devices,
    soft_signal_r_and_setter,
    soft_signal_rw,
)
from ophyd_async.core import StandardReadableFormat as Format

import rcg


class TriggerBoxDevice(StandardReadable):
    """Fires a schedule at each trigger; reads how many steps were fired, how many the camera missed, and how long it exposed."""

    def __init__(self, port: str, name: str = "") -> None:
        self._port = port
        self._box: rcg.TriggerBox | None = None
        with self.add_children_as_readables(Format.CONFIG_SIGNAL):
            self.steps = soft_signal_rw(int, 30)
            self.exposure = soft_signal_rw(float, 1e-3, units="s")
            self.period = soft_signal_rw(float, 33.3e-3, units="s")
        with self.add_children_as_readables(Format.HINTED_SIGNAL):
            self.fired, self._set_fired = soft_signal_r_and_setter(int)
            self.missed, self._set_missed = soft_signal_r_and_setter(int)
        with self.add_children_as_readables():
            self.exposed, self._set_exposed = soft_signal_r_and_setter(float, float("nan"), units="s")
        super().__init__(name=name)

    async def connect(self, mock=False, timeout=10.0, force_reconnect=False) -> None:
        await super().connect(mock, timeout, force_reconnect)
        if not mock and (self._box is None or force_reconnect):
            self._box = await asyncio.to_thread(rcg.TriggerBox, self._port)

    @AsyncStatus.wrap
    async def trigger(self) -> None:
        steps, exposure, period = await asyncio.gather(
            self.steps.get_value(), self.exposure.get_value(), self.period.get_value()
        )
        # The box is waited for on another thread; the library lets Python's other threads run.
        records = await asyncio.to_thread(self._box.run, steps=steps, exposures=[exposure], period=period)
        widths = records["strobe_width_ticks"] / self._box.info()["clock_hz"]
        self._set_fired(len(records))
        self._set_missed(int(((records["flags"] & rcg.Flag.MISSED) != 0).sum()))
        self._set_exposed(float(np.nanmean(widths)) if np.isfinite(widths).any() else float("nan"))


def main(port: str) -> list[dict]:
    """Two readings; the documents of their events."""
    events = []
    engine = RunEngine()
    with init_devices():
        box = TriggerBoxDevice(port, name="box")
    engine(bp.count([box], num=2), {"event": lambda _, document: events.append(document)})
    return events


if __name__ == "__main__":
    for event in main(sys.argv[1] if len(sys.argv) > 1 else "sim"):
        print(event["data"])
