//! Any bytes as a log of the laboratory's flight stack.

use crate::flights::check_log;
use importers::{Acsl, ImportOptions};

pub(crate) fn run(bytes: &[u8]) {
    check_log(&Acsl, bytes, &ImportOptions::default());
}
