"""Writes a data set in the layout that LeRobotDataset v3 documents: three episodes in two data files, without videos.

    python write_lerobot.py OUTDIR

`meta/info.json`, `meta/tasks.parquet`, `meta/episodes/chunk-000/file-000.parquet`, `data/chunk-000/file-{000,001}.parquet`: the rover of `write_rovers.py`
from three initial speeds, in single precision as LeRobot keeps it. The files are kept in `tests/data/lerobot`.

Layout: <https://huggingface.co/docs/lerobot/lerobot-dataset-v3>. Needs pyarrow, numpy.
"""

import json
import math
import sys
from pathlib import Path

import numpy
import pyarrow
import pyarrow.parquet

STEP, LENGTHS = 0.02, (150, 120, 90)


def episode(number: int, first: int):
    """Rows of an episode: lists of one length, and the columns that every data set has."""
    v, states, actions = 1.0 - number, [], []
    for k in range(LENGTHS[number]):
        u = math.sin(0.05 * k + number) + 0.3 * math.cos(0.37 * k)
        states.append([v, -v, k % 3])
        actions.append([u, 2 * u])
        v += STEP * (3.0 * u - 2.0 * v)
    rows = numpy.arange(LENGTHS[number])
    vectors = lambda values, width: pyarrow.FixedSizeListArray.from_arrays(pyarrow.array(numpy.ravel(values), pyarrow.float32()), width)
    return pyarrow.table(
        {
            "observation.state": vectors(states, 3),
            "action": vectors(actions, 2).cast(pyarrow.list_(pyarrow.float32())),
            "timestamp": pyarrow.array(rows * STEP, pyarrow.float32()),
            "frame_index": rows,
            "episode_index": numpy.full(len(rows), number),
            "index": first + rows,
            "task_index": numpy.zeros(len(rows), numpy.int64),
        }
    )


def write(path: Path, table):
    path.parent.mkdir(parents=True, exist_ok=True)
    pyarrow.parquet.write_table(table, path, row_group_size=100)


def main():
    folder = Path(sys.argv[1])
    starts = [sum(LENGTHS[:number]) for number in range(len(LENGTHS))]
    episodes = [episode(number, start) for number, start in enumerate(starts)]
    path = "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
    write(folder / path.format(chunk_index=0, file_index=0), pyarrow.concat_tables(episodes[:2]))
    write(folder / path.format(chunk_index=0, file_index=1), episodes[2])
    columns = {
        "episode_index": [0, 1, 2],
        "tasks": [["drive"]] * 3,
        "length": list(LENGTHS),
        "data/chunk_index": [0, 0, 0],
        "data/file_index": [0, 0, 1],
        "dataset_from_index": starts,
        "dataset_to_index": [start + length for start, length in zip(starts, LENGTHS, strict=True)],
    }
    write(folder / "meta/episodes/chunk-000/file-000.parquet", pyarrow.table(columns))
    write(folder / "meta/tasks.parquet", pyarrow.table({"task_index": [0], "__index_level_0__": ["drive"]}))
    feature = lambda dtype, names: {"dtype": dtype, "shape": [len(names) if names else 1], "names": names}
    info = {
        "codebase_version": "v3.0",
        "robot_type": "rover",
        "total_episodes": 3,
        "total_frames": sum(LENGTHS),
        "total_tasks": 1,
        "chunks_size": 1000,
        "data_files_size_in_mb": 100,
        "video_files_size_in_mb": 200,
        "fps": 50,
        "splits": {"train": "0:3"},
        "data_path": path,
        "video_path": None,
        "features": {
            "observation.state": feature("float32", ["v", "back", "mode"]),
            "action": feature("float32", ["u", "double"]),
            "timestamp": feature("float32", None),
            **{name: feature("int64", None) for name in ("frame_index", "episode_index", "index", "task_index")},
        },
    }
    (folder / "meta/info.json").write_text(json.dumps(info, indent=4) + "\n")


main()
