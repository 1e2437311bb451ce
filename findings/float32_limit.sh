#!/bin/sh
# A float32 range at the limit of 5.6 m: whether it is below 5.6 depends on how the number was handed over.
#
# Packages: numpy 2.4.6, pandas 3.1.1, polars 2.1.0, duckdb 2.0.1, pyarrow 26.0.1.
# Guess:    all say the same of one Parquet file: 5.6 is not below 5.6.
# Seen:     float32 stores 5.6 as 5.599999905. Rows of [5.6, 1, 2] that are < 5.6:
#             2  numpy and pandas with a Python float, polars with a Python float or its SQL, DuckDB with a literal 5.6
#             3  numpy and polars with np.float64(5.6), pandas with dtype_backend="pyarrow", read_parquet(filters=...),
#                pyarrow.compute and datasets, DuckDB with 5.6e0 or with 5.6 as a parameter of a prepared query
#           So one DuckDB query changes its answer when the literal becomes a "?", and pandas when the filter moves into
#           read_parquet.
# So what:  LaserScan has float32 ranges, and some drivers and simulators give range_max itself for "no return"
#           (5.6 m is that of a Hokuyo URG-04LX). "Hits are below range_max" keeps or drops every beam without a return.
#           Compare against a float32 limit (CAST(5.6 AS FLOAT), np.float32(5.6)), or with a margin.
set -eu
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
python3 -m venv "$work/venv"
"$work/venv/bin/pip" install --quiet numpy==2.4.6 pandas==3.1.1 polars==2.1.0 duckdb==2.0.1 pyarrow==26.0.1
cd "$work"
"$work/venv/bin/python" - <<'PYTHON'
import duckdb
import numpy as np
import pandas as pd
import polars as pl
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.dataset as ds
import pyarrow.parquet as pq

LIMIT = 5.6
ranges = np.array([LIMIT, 1, 2], np.float32)
table = pa.table({"range": ranges})
pq.write_table(table, "ranges.parquet")
scan = pl.scan_parquet("ranges.parquet")
duck = "SELECT count(*) FROM 'ranges.parquet' WHERE range < "
answers = {
    "numpy, Python float": (ranges < LIMIT).sum(),
    "pandas, Python float": (pd.read_parquet("ranges.parquet").range < LIMIT).sum(),
    "polars, Python float": scan.filter(pl.col("range") < LIMIT).collect().height,
    "polars, SQL": pl.SQLContext(ranges=scan).execute("SELECT * FROM ranges WHERE range < 5.6").collect().height,
    "duckdb, literal": duckdb.sql(duck + "5.6").fetchall()[0][0],
    "numpy, float64": (ranges < np.float64(LIMIT)).sum(),
    "polars, float64": scan.filter(pl.col("range") < np.float64(LIMIT)).collect().height,
    "pandas, Arrow types": (pd.read_parquet("ranges.parquet", dtype_backend="pyarrow").range < LIMIT).sum(),
    "pandas, filters of read_parquet": len(pd.read_parquet("ranges.parquet", filters=[("range", "<", LIMIT)])),
    "pyarrow, compute": pc.sum(pc.less(table["range"], LIMIT)).as_py(),
    "pyarrow, dataset": ds.dataset("ranges.parquet").to_table(filter=pc.field("range") < LIMIT).num_rows,
    "duckdb, 5.6e0": duckdb.sql(duck + "5.6e0").fetchall()[0][0],
    "duckdb, parameter": duckdb.execute(duck + "?", [LIMIT]).fetchall()[0][0],
}
for name, count in answers.items():
    print(count, name)
assert list(map(int, answers.values())) == [2] * 5 + [3] * 8, answers
PYTHON
