# SPDX-License-Identifier: MIT OR Apache-2.0
import importlib.util
import os


def missing(test, what):
    """Skips a test, or fails where CI is set, because nobody would notice it there."""
    if "CI" in os.environ:
        test.fail(f"not run: there is {what}")
    test.skipTest(f"not run: there is {what}")


def optional(test, package):
    """Skips a test whose package is missing."""
    if importlib.util.find_spec(package) is None:
        missing(test, f"no {package} (pip install {package})")
