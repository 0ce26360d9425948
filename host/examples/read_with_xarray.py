"""Reads a brdf.zarr with xarray: names and units, the mean, one slice.

    pip install "xarray>=2025.1" "zarr>=3"
    python read_with_xarray.py out/brdf.zarr
"""

import sys

import numpy as np
import xarray as xr


def outgoing_directions(size):
    """Polar angle and azimuth in degrees of each cell, [y, x]; NaN beyond the horizon.

    The cells are an equal-area disk (the attribute outgoing_grid): x + iy = sqrt(2) sin(theta/2) exp(i phi).
    """
    centres = (np.arange(size) + 0.5) / size * 2 - 1
    x, y = np.meshgrid(centres, centres)
    radius = np.hypot(x, y)
    theta = 2 * np.arcsin(np.where(radius <= 1, radius, np.nan) / np.sqrt(2))
    return np.degrees(theta), np.degrees(np.arctan2(y, x)) % 360


def main(path):
    # Zarr v3 without consolidated metadata; arrays are read when they are needed.
    brdf = xr.open_zarr(path, consolidated=False)
    print(f"{brdf.attrs['title']}; rig {brdf.attrs['rig']}, sizes {dict(brdf.sizes)}")
    for name, array in sorted(brdf.variables.items()):
        print(f"  {name:20} {str(array.dims):34} {array.attrs['units']:7} {array.attrs['long_name']}")

    # What has no value is NaN, which means leave out.
    has_value = float(brdf.f.notnull().mean())
    print(f"mean f = {float(brdf.f.mean()):.4f} 1/sr over the {100 * has_value:.1f} % of the table that have a value")
    relative = (brdf.sigma.astype("f4") / brdf.f).where(brdf.f > 0)
    print(f"median standard uncertainty = {100 * float(relative.median()):.2f} % of f")

    # A slice: the captured incident direction nearest to (45 deg, 0 deg), and the row of cells next to the middle of the disk,
    # half a cell beside the plane of incidence.
    off = np.hypot(brdf.incident_theta - 45, (brdf.incident_phi + 180) % 360 - 180)
    row = int(off.where(brdf.incident_reason == 0).argmin("incident"))
    theta_i, phi_i = (float(brdf[name][row]) for name in ("incident_theta", "incident_phi"))
    size = brdf.sizes["y"]
    y = size // 2 - 1
    theta, phi = (angles[y] for angles in outgoing_directions(size))
    cells = brdf.isel(incident=row, y=y, channel=0).load()
    print(f"incident ({theta_i:.2f} deg, {phi_i:.2f} deg), channel 0, outgoing:")
    for x in range(0, size, max(1, size // 16)):
        where = f"  ({theta[x]:5.2f} deg, {phi[x]:6.2f} deg)"
        if np.isnan(cells.f[x]):
            print(f"{where}  no value")
        else:
            print(f"{where}  f = ({float(cells.f[x]):.4f} +- {float(cells.sigma[x]):.4f}) 1/sr")


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    main(sys.argv[1])
