"""Revolutions of the hand-written slider-crank of the tag `before-linkage`, in a process of its
own."""

import io
import json
import os
import subprocess
import sys
import tarfile
import tempfile

from benchmarks.project import ROOT

TAG = "before-linkage"

_SCRIPT = """
import json, math, sys, time
from jointgap.config import Simulate
from jointgap.dynamics.compile_mechanism import parameters
from jointgap.dynamics.simulation import crank_angles, integrate_to_angles, start_state
from tests.dynamics.cases import mechanism

chosen = Simulate(
    speed=20 * math.pi, revolutions=4, samples_per_revolution=36, tolerance=1e-9
)
angles, ready = crank_angles(chosen), {}
for line in sys.stdin:
    loose = tuple(json.loads(line))
    if loose not in ready:
        ready[loose] = parameters(mechanism(loose=loose, friction=0.05), chosen)
        integrate_to_angles(ready[loose], start_state(ready[loose]), angles, 1e-9)
    begin = time.process_time()
    integrate_to_angles(ready[loose], start_state(ready[loose]), angles, 1e-9)
    print(time.process_time() - begin, flush=True)
"""


class Revolutions:
    """Times of four revolutions at 1e-9 m by loose joints; `runs` is false without the tag."""

    def __init__(self, mixes: list[tuple[str, ...]]):
        self._mixes = mixes
        self._folder = tempfile.TemporaryDirectory()
        self._process: subprocess.Popen | None = None

    def __enter__(self) -> "Revolutions":
        archive = subprocess.run(
            ["git", "archive", TAG, "src", "tests"], cwd=ROOT, capture_output=True, check=False
        )
        if archive.returncode == 0:
            with tarfile.open(fileobj=io.BytesIO(archive.stdout)) as files:
                files.extractall(self._folder.name, filter="data")
            path = os.pathsep.join([os.path.join(self._folder.name, "src"), self._folder.name])
            self._process = subprocess.Popen(
                [sys.executable, "-c", _SCRIPT],
                cwd=self._folder.name,
                env={**os.environ, "PYTHONPATH": path},
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                text=True,
            )
            for loose in self._mixes:  # compiled
                self.seconds(loose)
        return self

    def __exit__(self, *_) -> None:
        if self._process:
            self._process.communicate()
        self._folder.cleanup()

    @property
    def runs(self) -> bool:
        return self._process is not None

    def seconds(self, loose: tuple[str, ...]) -> float:
        """Processor time [s]."""
        self._process.stdin.write(json.dumps(loose) + "\n")
        self._process.stdin.flush()
        return float(self._process.stdout.readline())
