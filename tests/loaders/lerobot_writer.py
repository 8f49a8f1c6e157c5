"""Write datasets in the layout of LeRobot 3: chunks of files, each with the frames of several episodes."""

import json

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

FPS = 1000
DATA_PATH = "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
ACCELERATION = "observation.imu.acceleration"
STATE = "observation.state"
N_FRAMES = 500
LEVELS = {"oak": 0.2, "foam": 0.05, "slate": 1.0}
"""Surface -> deviation of the acceleration."""


def rows_of(surface, index, n=N_FRAMES):
    """Return the acceleration (n, 3) of an episode."""
    rng = np.random.default_rng([index, *map(ord, surface)])
    frequency = {"oak": 60, "foam": 20, "slate": 150}[surface]
    tone = np.sin(2 * np.pi * frequency * np.arange(n) / FPS)[:, None] * [1, 0.5, 0.2]
    return LEVELS[surface] * (tone + 0.5 * rng.standard_normal((n, 3))) + [0, 0, 9.81]


def write_lerobot(
    root,
    surfaces=("oak", "foam", "oak", "foam", "slate", "slate"),
    *,
    n_per_file=2,
    chunk=2,
    features=None,
    columns=None,
    info=None,
    tasks=None,
    times=lambda n: np.arange(n) / FPS,
    length=N_FRAMES,
):
    """Write a dataset with one episode per surface.

    `columns` are functions of surface and index that return the values of further features; each file has
    `n_per_file` episodes, each chunk `chunk` files.
    """
    default = {
        ACCELERATION: {"dtype": "float32", "shape": [3], "names": ["x", "y", "z"]},
        "observation.images.wrist": {"dtype": "video", "shape": [480, 640, 3], "names": None},
        "action": {"dtype": "float32", "shape": [2], "names": {"motors": ["pan", "lift"]}},
        "surface_id": {"dtype": "int64", "shape": [1], "names": None},
        "timestamp": {"dtype": "float32", "shape": [1]},
    }
    indices = ("frame_index", "episode_index", "index", "task_index")
    default |= {name: {"dtype": "int64", "shape": [1]} for name in indices} | (features or {})
    makers = {
        ACCELERATION: lambda surface, index: rows_of(surface, index).tolist(),
        "action": lambda surface, index: np.zeros((N_FRAMES, 2)).tolist(),
        "surface_id": lambda surface, index: [sorted(LEVELS).index(surface)] * N_FRAMES,
    } | (columns or {})
    described = {"codebase_version": "v3.0", "fps": FPS, "features": default, "data_path": DATA_PATH}
    described |= {"total_episodes": len(surfaces), "robot_type": "arm"} | (info or {})
    (root / "meta" / "episodes" / "chunk-000").mkdir(parents=True)
    (root / "meta" / "info.json").write_text(json.dumps(described), encoding="utf-8")
    episodes = []
    for first in range(0, len(surfaces), n_per_file):
        file = first // n_per_file
        numbers = {"chunk_index": file // chunk, "file_index": file % chunk}
        path = root / DATA_PATH.format(**numbers)
        path.parent.mkdir(parents=True, exist_ok=True)
        tables = []
        for index, surface in list(enumerate(surfaces))[first : first + n_per_file]:
            task = (tasks or {}).get(index, [f"stroke the {surface}"])
            values = {name: make(surface, index) for name, make in makers.items()}
            values |= {
                "frame_index": list(range(N_FRAMES)),
                "episode_index": [index] * N_FRAMES,
                "index": list(range(index * N_FRAMES, (index + 1) * N_FRAMES)),
                "task_index": [0] * N_FRAMES,
                "timestamp": np.float32(times(N_FRAMES)).tolist(),
            }
            types = {"timestamp": pa.float32()}
            if len(default[ACCELERATION]["shape"]) == 1:
                types[ACCELERATION] = pa.list_(pa.float32(), 3)
            tables.append(pa.table({n: pa.array(v, types.get(n)) for n, v in values.items()}))
            episodes.append(
                {
                    "episode_index": index,
                    "data/chunk_index": numbers["chunk_index"],
                    "data/file_index": numbers["file_index"],
                    "dataset_from_index": index * N_FRAMES,
                    "dataset_to_index": (index + 1) * N_FRAMES,
                    "tasks": task,
                    "length": length,
                    "stats/action/mean": [0.0, 0.0],
                }
            )
        pq.write_table(pa.concat_tables(tables), path, row_group_size=N_FRAMES)
    pq.write_table(pa.Table.from_pylist(episodes), root / "meta/episodes/chunk-000/file-000.parquet")
    return root
