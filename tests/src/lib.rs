//! On-target tests of both boards.
