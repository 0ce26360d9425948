"""Mitsuba 3 as a judge: it evaluates what is exported and the files of others."""

import numpy as np
import pytest
from conftest import DATA, drawn

import rcg

mitsuba = pytest.importorskip("mitsuba", reason="no mitsuba (pip install -r requirements.txt)")
PAIRS = 2000
FILES = sorted(DATA.glob("*_rgb.bsdf"))


def by_mitsuba(path, wi, wo):
    """f in 1/sr [N, 3] at unit vectors [N, 3] by Mitsuba's plugin `measured`, in single precision."""
    mitsuba.set_variant("scalar_rgb")
    bsdf = mitsuba.load_dict({"type": "measured", "filename": str(path)})
    context, interaction = mitsuba.BSDFContext(), mitsuba.SurfaceInteraction3f()
    values = np.empty((len(wi), 3))
    for row, (light, view) in enumerate(zip(wi, wo, strict=True)):
        interaction.wi = mitsuba.ScalarVector3f(light)
        # Mitsuba's value has the cosine of the other direction in it.
        values[row] = np.array(bsdf.eval(context, interaction, mitsuba.ScalarVector3f(view))) / view[2]
    return values


def errors_of_export(source, out, **options):
    """Relative differences [pair] of the worst channel between ``source`` here and its export in Mitsuba, ascending."""
    rcg.export(source, out=out, **options)
    wi, wo = drawn(PAIRS, 75, seed=3), drawn(PAIRS, 75, seed=4)
    ours, theirs = rcg.Brdf(source).eval(wi, wo), by_mitsuba(out, wi, wo)
    errors = np.sort(np.abs(theirs / ours - 1).max(axis=1))
    print(f"{source}: median {np.median(errors):.4%}, largest {errors[-1]:.3%}")
    return errors


def test_an_exported_measurement_of_cloth_is_the_same_in_mitsuba(whole, tmp_path):
    errors = errors_of_export(whole, tmp_path / "cloth.bsdf", resolution=96)
    assert np.median(errors) <= 0.005 and errors[-1] <= 0.03


@pytest.mark.skipif(not FILES, reason=f"no files of the RGL database in {DATA}")
@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_an_exported_file_of_rgl_is_the_same_in_mitsuba(path, tmp_path):
    errors = errors_of_export(path, tmp_path / "again.bsdf")
    # Where the light nearly grazes and f rises steeply, one pair of satin_rosaline falls between the points of the table.
    assert np.median(errors) <= 0.005 and errors[-2] <= 0.03


@pytest.mark.skipif(not FILES, reason=f"no files of the RGL database in {DATA}")
@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_files_of_rgl_are_read_as_mitsuba_reads_them(path):
    wi, wo = drawn(PAIRS, 75, seed=5), drawn(PAIRS, 75, seed=6)
    ours, theirs = rcg.Brdf(path).eval(wi, wo), by_mitsuba(path, wi, wo)
    np.testing.assert_allclose(ours, theirs, rtol=1e-4, atol=1e-7)
