"""Read Parquet files by DuckDB; print their columns and what the file says of itself as JSON."""

from __future__ import annotations

import json
import sys

import duckdb

found = {}
for path in sys.argv[1:]:
    table = duckdb.sql(f"select * from '{path}'")
    said = duckdb.sql(f"select decode(key), decode(value) from parquet_kv_metadata('{path}')").fetchall()
    columns = {name: [row[k] for row in table.fetchall()] for k, name in enumerate(table.columns)}
    found[path] = {"columns": columns, "said": dict(said)}
print(json.dumps(found))
