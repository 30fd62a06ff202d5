# SPDX-License-Identifier: MIT OR Apache-2.0
"""`pip install` of this folder into a fresh environment: the installed package passes tests of its own.

pip builds a package with setuptools, which it would download. `.ci/run` puts it into `target/pymavlink/wheels` before.
"""

import os
import shutil
import subprocess
import sys
import tempfile
import unittest
import venv
from pathlib import Path

from tests import missing
from tests.test_tapes import FOLDER

HERE = Path(__file__).parents[1]
WHEELS = HERE.parent / "target/pymavlink/wheels"


class Installed(unittest.TestCase):
    def run_in(self, folder, *command):
        environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
        run = subprocess.run(command, cwd=folder, capture_output=True, text=True,
                             env={**environment, "HORUS_TAPES": str(FOLDER), "PYTHONDONTWRITEBYTECODE": "1"})
        self.assertEqual(run.returncode, 0, run.stdout + run.stderr)
        return run.stdout

    def test_a_fresh_environment_has_the_whole_package(self):
        if not list(WHEELS.glob("setuptools-*.whl")):
            missing(self, f"no setuptools in {WHEELS} (pip download --no-deps setuptools -d {WHEELS})")
        with tempfile.TemporaryDirectory() as folder:
            fresh = Path(folder) / "fresh"
            venv.create(fresh)
            python = str(fresh / "bin/python")
            # pip leaves what it builds beside the sources.
            sources = Path(folder) / "sources"
            shutil.copytree(HERE, sources, ignore=shutil.ignore_patterns("__pycache__", "build", "*.egg-info"))
            self.run_in(folder, sys.executable, "-m", "pip", "--python", python, "install", "--quiet", "--no-index",
                        "--find-links", str(WHEELS), str(sources))
            shutil.rmtree(sources / "horus_profile")
            where = self.run_in(sources, python, "-c", "import horus_profile; print(horus_profile.__file__)")
            package = Path(where.strip()).parent
            self.assertTrue(package.is_relative_to(fresh.resolve()), where)
            left = {path.name for path in (HERE / "horus_profile").iterdir()} - {"__pycache__"}
            self.assertEqual({path.name for path in package.iterdir()} - {"__pycache__"}, left)
            self.run_in(sources, python, "-m", "unittest", "tests.test_objects", "tests.test_layout", "tests.test_tapes")


if __name__ == "__main__":
    unittest.main()
