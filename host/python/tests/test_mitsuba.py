"""Mitsuba 3 as a judge: it evaluates what is exported and the files of others."""

import os
import subprocess
from pathlib import Path

import numpy as np
import pytest
from conftest import DATA, drawn

import rcg

mitsuba = pytest.importorskip("mitsuba", reason="no mitsuba (pip install -r requirements.txt)")
PAIRS = 2000
# Linear sRGB of X, Y, Z (IEC 61966-2-1).
SRGB = np.array([[3.2406, -1.5372, -0.4986], [-0.9689, 1.8758, 0.0415], [0.0557, -0.2040, 1.0570]])
FILES = sorted(DATA.glob("*_rgb.bsdf"))
TARGET = Path(os.environ.get("CARGO_TARGET_DIR", Path(__file__).parents[3] / "target"))
COMMANDS = [path for path in (TARGET / "debug" / "rcg", TARGET / "release" / "rcg") if path.is_file()]


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


@pytest.fixture(scope="module")
def exported(whole, tmp_path_factory):
    """A measurement with noise as a ``.bsdf``, as small as is as good."""
    out = tmp_path_factory.mktemp("exported") / "whole.bsdf"
    answer = rcg.export(whole, out=out)
    assert answer["table"]["form"] == "compact", answer
    return out


def test_a_dense_table_of_cloth_is_the_same_in_mitsuba(tmp_path):
    errors = errors_of_export("satin", tmp_path / "cloth.bsdf", resolution=96, table="dense")
    assert np.median(errors) <= 0.005 and errors[-1] <= 0.04


def test_a_measurement_is_in_mitsuba_far_within_its_uncertainty(whole, exported):
    wi, wo = drawn(PAIRS, 75, seed=7), drawn(PAIRS, 75, seed=8)
    brdf = rcg.Brdf(whole)
    ours = brdf.eval(wi, wo)
    errors = np.abs(by_mitsuba(exported, wi, wo) - ours)
    off = errors / brdf.sigma(wi, wo)
    within, median = (off <= 0.5).all(axis=1).mean(), np.median(errors / ours)
    print(f"median {median:.3%}; {within:.2%} within half of the standard uncertainty, at most {off.max():.2f} of it")
    assert within >= 0.99 and median <= 0.003


def test_mitsuba_draws_directions_as_much_as_is_reflected_there(exported):
    mitsuba.set_variant("scalar_rgb")
    bsdf = mitsuba.load_dict({"type": "measured", "filename": str(exported)})
    context, interaction = mitsuba.BSDFContext(), mitsuba.SurfaceInteraction3f()
    for light, chance in zip(drawn(4, 70, seed=9), np.random.default_rng(10).random((4, 500, 2)), strict=True):
        interaction.wi = mitsuba.ScalarVector3f(light)
        weights = [bsdf.sample(context, interaction, 0.5, mitsuba.ScalarPoint2f(one))[1][1] for one in chance]
        # Each draw has the weight of the others: the directional albedo.
        assert np.std(weights) <= 0.1 * np.mean(weights)


@pytest.mark.skipif(not COMMANDS, reason=f"no command rcg under {TARGET} (cargo build)")
def test_mitsuba_renders_a_sphere_as_the_command_does(whole, exported, tmp_path):
    mitsuba.set_variant("scalar_rgb")
    size, finer = 64, 4
    theta, phi = np.radians([50, 210])
    light = np.array([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)])
    picture = tmp_path / "ball.exr"
    words = ["render", whole, "--out", picture, "--size", str(size * finer), "--light", "50,210", "--quiet"]
    subprocess.run([COMMANDS[0], *words], check=True, capture_output=True)
    ours = np.array(mitsuba.Bitmap(str(picture))).reshape(size, finer, size, finer, 4)
    # Alpha is 0 beside the sphere and where nothing was measured.
    known = ours[..., 3].min(axis=(1, 3)) > 0
    transform = mitsuba.ScalarTransform4f
    scene = mitsuba.load_dict(
        {
            "type": "scene",
            "integrator": {"type": "direct", "emitter_samples": 1, "bsdf_samples": 0},
            "sensor": {
                "type": "orthographic",
                "to_world": transform().look_at([0, 0, 5], [0, 0, 0], [0, 1, 0]),
                "film": {"type": "hdrfilm", "width": size, "height": size, "rfilter": {"type": "box"}, "pixel_format": "rgb"},
            },
            "light": {"type": "directional", "direction": list(-light), "irradiance": {"type": "rgb", "value": 1.0}},
            # +x of the sample runs around the picture's vertical axis.
            "ball": {
                "type": "sphere",
                "to_world": transform().rotate([1, 0, 0], -90).scale(0.96),
                "bsdf": {"type": "measured", "filename": str(exported)},
            },
        }
    )
    theirs = np.array(mitsuba.render(scene, spp=16))
    ours = ours[..., :3].mean(axis=(1, 3))
    psnr = 10 * np.log10(ours.max() ** 2 / np.mean((ours - theirs)[known] ** 2))
    print(f"{psnr:.1f} dB, {known.mean():.1%} of the picture")
    assert psnr >= 40 and known.mean() > 0.6


@pytest.mark.skipif(not FILES, reason=f"no files of the RGL database in {DATA}")
@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_an_exported_file_of_rgl_is_the_same_in_mitsuba(path, tmp_path):
    errors = errors_of_export(path, tmp_path / "again.bsdf")
    assert errors[-1] <= 1e-4


@pytest.mark.skipif(not FILES, reason=f"no files of the RGL database in {DATA}")
@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_files_of_rgl_are_read_as_mitsuba_reads_them(path):
    wi, wo = drawn(PAIRS, 75, seed=5), drawn(PAIRS, 75, seed=6)
    ours, theirs = rcg.Brdf(path).eval(wi, wo), by_mitsuba(path, wi, wo)
    np.testing.assert_allclose(ours, theirs, rtol=1e-4, atol=1e-7)


def tensor_file(path, fields):
    """Writes arrays by name as a tensor file."""
    kinds = {np.dtype(np.uint8): 1, np.dtype(np.float32): 10}
    heads = sum(13 + len(name) + 8 * array.ndim for name, array in fields.items())
    header = b"tensor_file\0\1\0" + np.uint32(len(fields)).tobytes()
    data, start = b"", len(header) + heads
    for name, array in fields.items():
        data += bytes(-(start + len(data)) % 8)
        header += np.uint16(len(name)).tobytes() + name.encode() + np.uint16(array.ndim).tobytes()
        header += bytes([kinds[array.dtype]]) + np.uint64(start + len(data)).tobytes() + np.uint64(array.shape).tobytes()
        data += array.tobytes()
    path.write_bytes(header + data)


def test_spectra_have_the_colours_that_they_have_in_mitsuba(tmp_path):
    """CIE 1931 2°, D65, linear sRGB, white scaled to 1, by Mitsuba's spectra and its own tables of observer and illuminant."""
    chance = np.random.default_rng(11)
    bands = np.arange(390, 731, 20, dtype=np.float32)
    shape = (1, 4, 12, 12)

    def drawn_table(*shape):
        return chance.uniform(0.2, 1, shape).astype(np.float32)

    # Smooth over wavelengths and of all directions' own colour, none beyond the primaries.
    phase = chance.uniform(0, 6, shape)[:, :, None]
    waves = 0.5 + 0.2 * np.sin(phase + bands[:, None, None] / 80)
    isotropic = drawn_table(1, 5)
    path = tmp_path / "spectra.bsdf"
    tensor_file(
        path,
        {
            "description": np.frombuffer(b"drawn", np.uint8),
            "phi_i": np.zeros(1, np.float32),
            "theta_i": np.linspace(0, np.pi / 2, 4, dtype=np.float32),
            "ndf": np.repeat(isotropic, 2, axis=0),
            "sigma": np.repeat(isotropic, 2, axis=0),
            "vndf": drawn_table(1, 4, 6, 6),
            "spectra": waves.astype(np.float32),
            "wavelengths": bands,
            "luminance": drawn_table(*shape),
            "jacobian": np.ones(1, np.uint8),
        },
    )
    mitsuba.set_variant("scalar_spectral")
    bsdf = mitsuba.load_dict({"type": "measured", "filename": str(path)})
    context, interaction = mitsuba.BSDFContext(), mitsuba.SurfaceInteraction3f()
    wavelengths = np.arange(360, 840, 4.0)
    daylight = mitsuba.load_dict({"type": "d65"})
    power = np.empty(len(wavelengths))
    wi, wo = drawn(40, 75, seed=12), drawn(40, 75, seed=13)
    spectra = np.empty((len(wi), len(wavelengths)))
    for at in range(0, len(wavelengths), 4):
        interaction.wavelengths = [float(nm) for nm in wavelengths[at : at + 4]]
        power[at : at + 4] = np.array(daylight.eval(interaction))
        for row, (light, view) in enumerate(zip(wi, wo, strict=True)):
            interaction.wi = mitsuba.ScalarVector3f(light)
            spectra[row, at : at + 4] = np.array(bsdf.eval(context, interaction, mitsuba.ScalarVector3f(view))) / view[2]
    observer = np.array([np.array(mitsuba.cie1931_xyz(nm)) for nm in wavelengths])
    weights = power[:, None] * observer @ SRGB.T
    theirs = spectra @ (weights / weights.sum(axis=0))
    ours = rcg.Brdf(path).eval(wi, wo)
    errors = np.abs(ours / theirs - 1).max(axis=1)
    print(f"median {np.median(errors):.3%}, largest {errors.max():.3%}")
    assert errors.max() <= 0.005
    assert np.ptp(ours / ours.mean(axis=1, keepdims=True)) > 0.1
