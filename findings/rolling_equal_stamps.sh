#!/bin/sh
# A rolling count over a second, where many rows have the stamp of one sweep: pandas gives each row another answer.
#
# Packages: pandas 3.1.1, polars 2.1.0, duckdb 2.0.1, numpy 2.4.6.
# Guess:    pandas rolling("1s", on=...) and polars rolling(period="1s") have the same windows, (t - 1 s, t], so that
#           rows of one stamp have one answer.
# Seen:     sweeps at 0, 0.5 and 1 s with 1, 3 and 2 objects:
#             pandas   1, 2 3 4, 4 5        the rows of the same sweep that stand further down are left out
#             polars   1, 4 4 4, 5 5
#             duckdb   1, 4 4 4, 6 6        (RANGE 1 second PRECEDING holds the row exactly 1 s ago, as SQL has it)
# So what:  a table of objects or of people has as many rows of one stamp as the sweep had objects. "How many in the
#           last second" by pandas depends on the order of the rows within a sweep and is right in the last of them
#           alone; a mean or a maximum is wrong as quietly. Aggregate by sweep first, then roll.
set -eu
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
python3 -m venv "$work/venv"
"$work/venv/bin/pip" install --quiet numpy==2.4.6 pandas==3.1.1 polars==2.1.0 duckdb==2.0.1 pyarrow==26.0.1
"$work/venv/bin/python" - <<'PYTHON'
import duckdb
import pandas as pd
import polars as pl

objects = pd.DataFrame({"t": pd.to_datetime([0, 500, 500, 500, 1000, 1000], unit="ms"), "n": 1})
by_pandas = [int(n) for n in objects.rolling("1s", on="t").n.sum()]
by_polars = pl.from_pandas(objects).rolling("t", period="1s").agg(pl.col("n").sum())["n"].to_list()
window = "sum(n) OVER (ORDER BY t RANGE BETWEEN INTERVAL 1 SECOND PRECEDING AND CURRENT ROW)"
by_duckdb = [int(row[0]) for row in duckdb.sql(f"SELECT {window} FROM objects ORDER BY t").fetchall()]
print("pandas", by_pandas)
print("polars", by_polars)
print("duckdb", by_duckdb)
assert by_pandas == [1, 2, 3, 4, 4, 5]
assert by_polars == [1, 4, 4, 4, 5, 5]
assert by_duckdb == [1, 4, 4, 4, 6, 6]
PYTHON
