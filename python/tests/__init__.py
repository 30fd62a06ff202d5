# SPDX-License-Identifier: MIT OR Apache-2.0
import importlib.util
import os


def optional(test, package):
    """Skips a test whose package is missing, or fails where CI is set, because nobody would notice it there."""
    if importlib.util.find_spec(package) is None:
        words = f"not run: there is no {package} (pip install {package})"
        if "CI" in os.environ:
            test.fail(words)
        test.skipTest(words)
