//! Environments of Python: `testkit`'s, in the build directory of these tests.

use std::path::{Path, PathBuf};
pub(crate) use testkit::python::{pip_install, said};

/// The interpreter of an environment of this name with these packages, or why this machine gives none.
pub(crate) fn environment(name: &str, packages: &[&str]) -> Result<PathBuf, String> {
    testkit::python::environment(&Path::new(env!("CARGO_TARGET_TMPDIR")).join(name), packages)
}
