"""Makes the Parquet fixtures of this folder with pyarrow (the version is printed into the files' metadata by pyarrow itself).

    python make_fixtures.py

Each file says in tests/fixtures.rs what must come out of it; the formulas here and there are the same.
"""

import datetime
import decimal

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

ROWS = 300
i = np.arange(ROWS)
NULL = i % 7 == 3


def nullable(values, kind):
    return pa.array([None if null else value for value, null in zip(values, NULL)], kind)


def types():
    """Every type that becomes a number, with nulls in every seventh row from the third on."""
    return pa.table(
        {
            "t": pa.array(1_700_000_000_000_000 + i * 10_000, pa.timestamp("us", tz="UTC")),
            "i8": nullable((i % 100 - 50).tolist(), pa.int8()),
            "u8": nullable((i % 256).tolist(), pa.uint8()),
            "i16": nullable((i - 150).tolist(), pa.int16()),
            "u16": nullable((i + 65_000).tolist(), pa.uint16()),
            "i32": nullable((i - 150).tolist(), pa.int32()),
            "u32": nullable((i + 4_294_966_000).tolist(), pa.uint32()),
            "i64": nullable((i - 150).tolist(), pa.int64()),
            "u64": nullable([int(k) + 2**63 for k in i], pa.uint64()),
            "f16": pa.array((i / 8).astype(np.float16)),
            "f32": nullable((i / 4).tolist(), pa.float32()),
            "f64": nullable((i / 3).tolist(), pa.float64()),
            "bool": nullable((i % 2 == 0).tolist(), pa.bool_()),
            "dec9": nullable([decimal.Decimal(int(k) - 150).scaleb(-2) for k in i], pa.decimal128(9, 2)),
            "dec38": nullable([decimal.Decimal(int(k) - 150).scaleb(-2) for k in i], pa.decimal128(38, 2)),
            "dict": nullable([["wet", "dry", "ice"][k % 3] for k in i], pa.string()).dictionary_encode(),
            "text": nullable([["wet", "dry", "ice"][k % 3] for k in i], pa.large_string()),
            "dict_int": nullable((i % 5 * 10).tolist(), pa.int32()).dictionary_encode(),
            "date": nullable([datetime.date(1970, 1, 1) + datetime.timedelta(days=int(k)) for k in i], pa.date32()),
            "ms": nullable((i * 1_500).tolist(), pa.timestamp("ms")),
            "list": pa.array([[1.0, 2.0]] * ROWS, pa.list_(pa.float64())),
            "binary": pa.array([b"\xff\x00"] * ROWS, pa.binary()),
            "pose": pa.array([{"x": k / 2, "deep": {"y": int(k)}} for k in i]),
        }
    )


def clock(column):
    return pa.table({"stamp": column, "x": pa.array(i / 3)})


def write(name, table, **options):
    pq.write_table(table, f"{name}.parquet", **options)


write("types", types(), row_group_size=128, write_statistics=False)
write("types_v2", types(), row_group_size=100, data_page_version="2.0", compression="zstd", write_page_index=True, data_page_size=256)
start = 1_700_000_000
for unit, scale in [("s", 1), ("ms", 10**3), ("us", 10**6), ("ns", 10**9)]:
    write(f"clock_{unit}", clock(pa.array((start * scale + i * max(scale // 100, 1)).tolist(), pa.timestamp(unit))))
write("clock_int96", clock(pa.array((start * 10**9 + i * 10**7).tolist(), pa.timestamp("ns"))), use_deprecated_int96_timestamps=True)
write("clock_text", clock(pa.array([f"2023-11-14T22:13:{20 + k // 100:02d}.{k % 100:02d}Z" for k in i])))
units = pa.schema([pa.field("time", pa.float64(), metadata={"unit": "s"}), pa.field("v", pa.float32(), metadata={"unit": "m/s"})])
write(
    "codecs",
    pa.Table.from_arrays([pa.array(i * 0.01), pa.array((i / 4).astype(np.float32))], schema=units),
    compression={"time": "brotli", "v": "gzip"},
    use_dictionary=False,
    column_encoding={"time": "BYTE_STREAM_SPLIT", "v": "BYTE_STREAM_SPLIT"},
)
write("lz4_delta", pa.table({"t_ms": pa.array((i * 20).tolist(), pa.int64()), "n": pa.array(i)}), compression="lz4", use_dictionary=False, column_encoding={"t_ms": "DELTA_BINARY_PACKED", "n": "DELTA_BINARY_PACKED"})
write("empty", pa.table({"t": pa.array([], pa.float64()), "x": pa.array([], pa.float64())}))
write(
    "durations",
    pa.table(
        # The name that pandas gives a TimedeltaIndex.
        {"__index_level_0__": pa.array((i * 50_000_000).tolist(), pa.duration("ns"))}
        | {unit: nullable((i * 1_500).tolist(), pa.duration(unit)) for unit in ["s", "ms", "us", "ns"]}
        | {"a": pa.array([{"us": int(k)} for k in i], pa.struct([("us", pa.duration("us"))]))}
    ),
)
