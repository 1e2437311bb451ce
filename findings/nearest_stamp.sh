#!/bin/sh
# The pose nearest to a sweep that lies midway between two: half of the libraries take the earlier, half the later one.
#
# Packages: pandas 3.1.1, polars 2.1.0, xarray 2026.9.0, scipy 1.17.1, numpy 2.4.6.
# Guess:    the joins of pandas and of polars both take the earlier pose, both calls of xarray the later one.
# Seen:     earlier: pandas.merge_asof, xarray interp(method="nearest"), scipy interp1d(kind="nearest")
#           later:   polars.join_asof, xarray sel(method="nearest"), pandas get_indexer(method="nearest")
# So what:  a laser at 20 Hz beside odometry at 10 Hz, both triggered by one clock, has every second sweep exactly
#           midway: the choice of a call moves half of all sweeps by a whole step of odometry (10 cm at 1 m/s).
#           Interpolate between poses, or break the tie by hand.
set -eu
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
python3 -m venv "$work/venv"
"$work/venv/bin/pip" install --quiet numpy==2.4.6 pandas==3.1.1 polars==2.1.0 pyarrow==26.0.1 xarray==2026.9.0 \
    scipy==1.17.1
"$work/venv/bin/python" - <<'PYTHON'
import pandas as pd
import polars as pl
import xarray as xr
from scipy.interpolate import interp1d

# poses every 100 ms, sweeps midway
poses = pd.DataFrame({"t": pd.to_datetime([0, 100, 200, 300], unit="ms"), "x": [0.0, 0.1, 0.2, 0.3]})
sweeps = pd.DataFrame({"t": pd.to_datetime([50, 150, 250], unit="ms")})
ms, wanted = [0, 100, 200, 300], [50, 150, 250]
along = xr.DataArray(poses.x.to_numpy(), coords={"t": ms}, dims="t")
earlier, later = [0.0, 0.1, 0.2], [0.1, 0.2, 0.3]
joined = pl.from_pandas(sweeps).join_asof(pl.from_pandas(poses), on="t", strategy="nearest")
nearest = {
    "pandas merge_asof": pd.merge_asof(sweeps, poses, on="t", direction="nearest").x.tolist(),
    "xarray interp": along.interp(t=wanted, method="nearest").values.tolist(),
    "scipy interp1d": interp1d(ms, poses.x, kind="nearest")(wanted).tolist(),
    "polars join_asof": joined["x"].to_list(),
    "pandas get_indexer": poses.x[pd.DatetimeIndex(poses.t).get_indexer(sweeps.t, method="nearest")].tolist(),
    "xarray sel": along.sel(t=wanted, method="nearest").values.tolist(),
}
for name, x in nearest.items():
    print(f"{name:20}", x, "earlier" if x == earlier else "later")
assert list(nearest.values()) == [earlier] * 3 + [later] * 3, nearest
PYTHON
