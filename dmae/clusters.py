"""Tasks on a Ray or a Dask cluster. If a process or machine dies, its task is given to another.

Both libraries are wrapped alike: `cores` tasks run at a time; `submit` returns a future, `first` waits for futures and
returns one that has ended, `result` returns or raises what its function did, and `cancel` ends a task or leaves it out.
"""

import logging
import os
import socket
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from functools import cache
from itertools import islice
from pathlib import Path

_RETRIES = 3  # Number of times that a task is given to another process after its process died
_AHEAD = 2  # Number of waiting tasks for each running task
_CARRIED = ("LP_NUM_THREADS", "MUJOCO_GL", "OMP_NUM_THREADS", "PYOPENGL_PLATFORM")
"""Environment variables of this process that tasks run with."""


class Ray:
    """The cluster that `RAY_ADDRESS` names, or else a local one of some processes.

    joblib's backend for Ray is not used: it returns results when all tasks have ended, and gives no task to another
    process.
    """

    def __init__(self, processes: int):
        import ray

        # Tasks request no GPU, but can still use those of their machine. Ray must not send usage statistics.
        os.environ.setdefault("RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO", "0")
        os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
        if not ray.is_initialized():
            quiet = {"log_to_driver": False, "logging_level": "ERROR"}
            if not os.environ.get("RAY_ADDRESS"):
                quiet |= {"num_cpus": processes, "include_dashboard": False}
            ray.init(**quiet)
        self.ray, self.cores = ray, int(ray.cluster_resources().get("CPU", 1))
        self.remote = ray.remote(_on_node).options(max_retries=_RETRIES)

    def submit(self, function, *arguments):
        return self.remote.remote(function, *arguments)

    def cancel(self, future):
        self.ray.cancel(future)

    def first(self, futures):
        return self.ray.wait(futures, num_returns=1)[0][0]

    def result(self, future):
        try:
            return self.ray.get(future)
        except self.ray.exceptions.RayTaskError as error:
            raise error.cause from None
        except self.ray.exceptions.WorkerCrashedError as error:
            raise RuntimeError(f"a task ended {_RETRIES + 1} processes, for lack of memory or by a crash") from error


class Dask:
    """The cluster that `DASK_SCHEDULER_ADDRESS` names, or else a local one of some processes."""

    def __init__(self, processes: int):
        import dask
        import distributed

        self.distributed = distributed
        try:
            self.client = distributed.default_client()
        except ValueError:
            local = {} if dask.config.get("scheduler-address", None) else {
                "n_workers": processes, "threads_per_worker": 1, "dashboard_address": None,
                "silence_logs": logging.CRITICAL,
            }  # fmt: skip
            self.client = distributed.Client(**local)
        self.cores = max(1, sum(self.client.ncores().values()))

    def submit(self, function, *arguments):
        return self.client.submit(_on_node, function, *arguments, pure=False)

    def cancel(self, future):
        future.cancel()

    def first(self, futures):
        done = self.distributed.wait(futures, return_when="FIRST_COMPLETED").done
        return next(future for future in futures if future in done)

    def result(self, future):
        return future.result()


Cluster = Ray | Dask
CLUSTERS = {"ray": Ray, "dask": Dask}


@cache
def connect(name: str, processes: int) -> Cluster:
    """Return the cluster of one of `CLUSTERS`, to which this process stays connected until it ends.

    A local one, where the environment names none, has so many processes. Raises ValueError without the library.
    """
    try:
        return CLUSTERS[name](processes)
    except ImportError as error:
        raise ValueError(f"backend={name}: {error}; pip install 'dmae-synth[cluster]'") from None


def on_cluster(
    function: Callable, tasks: Iterable[tuple], cluster: Cluster, at_once: int, *, ordered: bool
) -> Iterator:
    """Yield `function(*task)` of each task, run on a cluster, so many at once, in their order or as each is ready."""
    carried = {name: os.environ[name] for name in _CARRIED if name in os.environ}
    remaining = ((str(Path.cwd()), carried, function, *task) for task in tasks)
    running: deque = deque()
    try:
        while True:
            running.extend(cluster.submit(*task) for task in islice(remaining, at_once * _AHEAD - len(running)))
            if not running:
                return
            future = running[0] if ordered else cluster.first(list(running))
            running.remove(future)
            yield cluster.result(future)
    finally:
        for future in running:
            cluster.cancel(future)


def _on_node(folder: str, environment: dict[str, str], function: Callable, *task):
    """Run a task in a worker, in the folder that relative paths begin in."""
    os.environ.update(environment)
    try:
        os.chdir(folder)
    except OSError as error:
        raise ValueError(
            f"{folder}: not there on {socket.gethostname()}, {error.strerror}; a cluster needs a folder that all its "
            "machines share, at the same path"
        ) from None
    return function(*task)
