"""The store as xarray sees it, with and without this package."""

import json

import dask.array
import numpy as np
import pytest
import xarray

import rcg


def test_xarray_alone_reads_the_same_lazily(cloth):
    ours, plain = rcg.open(cloth), xarray.open_zarr(cloth / "brdf.zarr", consolidated=False)
    assert ours.f.dims == ("incident", "y", "x", "channel")
    assert isinstance(ours.f.data, dask.array.Array)
    assert isinstance(plain.f.data, dask.array.Array)
    for name, variable in plain.variables.items():
        np.testing.assert_array_equal(ours[name], variable)
        assert ours[name].attrs == variable.attrs
    assert set(ours.variables) - set(plain.variables) == {"outgoing_theta", "outgoing_phi"}
    assert ours.attrs == plain.attrs
    assert rcg.open(cloth / "brdf.zarr").identical(ours)


def test_values_at_captured_directions_are_those_of_the_table(cloth):
    data, brdf = rcg.open(cloth, chunks=None).load(), rcg.Brdf(cloth, interpolation="direct")
    assert data.f.attrs["units"] == "sr-1"
    theta, phi = data.outgoing_theta.values, data.outgoing_phi.values
    # The middle of the disk: at the horizon interpolation has less than four cells.
    cells = np.argwhere(theta < 60)[::37]
    theta_i, phi_i = data.incident_theta.values, data.incident_phi.values
    row = int(np.argmin(np.hypot(theta_i - 45, phi_i - 30)))
    wi = rcg.from_degrees(theta_i[row], phi_i[row])
    y, x = cells.T
    found = brdf.eval(wi, rcg.from_degrees(theta[y, x], phi[y, x]))
    np.testing.assert_allclose(found, data.f.values[row, y, x], rtol=1e-5, equal_nan=True)


def test_nan_and_provenance_tell_the_same(cloth):
    data = rcg.open(cloth).load()
    assert bool((data.f.isnull().all("channel") == (data.provenance == 0)).all())
    assert (data.sigma.where(data.provenance > 0).min() >= 0).item()


@pytest.mark.parametrize("what", ["nothing", "file", "folder", "group"])
def test_what_is_no_dataset_is_refused_by_name(what, tmp_path):
    path = tmp_path / "some.zarr"
    if what == "file":
        path.write_text("{}")
    elif what != "nothing":
        path.mkdir()
    if what == "group":
        group = {"zarr_format": 3, "node_type": "group", "attributes": {}}
        (path / "zarr.json").write_text(json.dumps(group))
    for reader in (rcg.open, rcg.Brdf, rcg.info):
        with pytest.raises((ValueError, OSError), match=r"some\.zarr.*expected .*found"):
            reader(path)
