#!/bin/sh
# DuckDB: which of two poses with one stamp an ASOF JOIN takes depends on how many sweeps are asked about.
#
# Packages: duckdb 2.0.1, pandas 3.1.1, polars 2.1.0, numpy 2.4.6.
# Guess:    where two rows have the stamp, a join backward takes the last of them, in DuckDB as in pandas and polars.
# Seen:     poses with two rows for each stamp, one sweep for each of n stamps:
#             n = 1 to 63       DuckDB takes the FIRST of each pair; pandas and polars the last
#             n = 64 and more   DuckDB takes the last of each pair
#           The plan changes from a nested loop at 64 rows on the left (asof_loop_join_threshold); with that set to 0 it
#           takes the last for any n.
# So what:  two publishers of one transform, or a log merged from two recordings, give equal stamps. A query tried on a
#           minute at one sweep a second (60 rows) joins other poses than the same query on the whole log. Make the
#           stamps of poses unique (arg_max by record time) before any join.
set -eu
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
python3 -m venv "$work/venv"
"$work/venv/bin/pip" install --quiet numpy==2.4.6 pandas==3.1.1 polars==2.1.0 duckdb==2.0.1 pyarrow==26.0.1
"$work/venv/bin/python" - <<'PYTHON'
import duckdb
import pandas as pd
import polars as pl

poses = pd.DataFrame({"t": [i // 2 for i in range(400)], "row": ["first", "last"] * 200})
QUERY = "SELECT row FROM sweeps ASOF JOIN poses ON sweeps.t >= poses.t"


def taken(sweeps, **settings):
    con = duckdb.connect(config=settings)
    con.register("poses", poses)
    con.register("sweeps", sweeps)
    by_duckdb = {row[0] for row in con.execute(QUERY).fetchall()}
    by_pandas = set(pd.merge_asof(sweeps, poses, on="t").row)
    by_polars = set(pl.from_pandas(sweeps).join_asof(pl.from_pandas(poses), on="t")["row"])
    print(len(sweeps), "sweeps", settings, "DuckDB", by_duckdb, "pandas", by_pandas, "polars", by_polars)
    assert by_pandas == by_polars == {"last"}
    return by_duckdb


for count in (1, 60, 63):
    assert taken(pd.DataFrame({"t": range(count)})) == {"first"}
for count in (64, 200):
    assert taken(pd.DataFrame({"t": range(count)})) == {"last"}
assert taken(pd.DataFrame({"t": range(60)}), asof_loop_join_threshold="0") == {"last"}
PYTHON
