"""What several tests look at: one measurement, as short as it may be, and what is made of it."""

from pathlib import Path

import numpy as np
import pytest

import rcg

DATA = Path(__file__).parents[4] / "shared" / "data"


def drawn(count: int, largest_deg: float, seed: int = 1) -> np.ndarray:
    """``count`` unit vectors [N, 3], evenly by solid angle, up to so many degrees from the normal."""
    chance = np.random.default_rng(seed)
    z = chance.uniform(np.cos(np.radians(largest_deg)), 1, count)
    phi = chance.uniform(0, 2 * np.pi, count)
    s = np.sqrt(1 - z * z)
    return np.stack([s * np.cos(phi), s * np.sin(phi), z], axis=-1)


@pytest.fixture(scope="session")
def cloth(tmp_path_factory) -> Path:
    """Anisotropic cloth, measured with the noise of the camera: the directory of the measurement."""
    out = tmp_path_factory.mktemp("measured") / "cloth"
    rcg.measure(out, rig="rcg-2", sample="satin", step_deg=10, image_size=48)
    return out


@pytest.fixture(scope="session")
def whole(cloth) -> Path:
    """The same without gaps: a brdf.zarr."""
    out = cloth.parent / "whole.zarr"
    rcg.fill(cloth, out=out)
    return out
