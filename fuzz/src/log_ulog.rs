//! Any bytes as a ULog of PX4.

use crate::flights::check_log;
use importers::{ImportOptions, Ulog};

pub(crate) fn run(bytes: &[u8]) {
    let options =
        ImportOptions { thrust_n: Some(30.0), torque_n_m: Some([1.0; 3]), ..ImportOptions::default() };
    check_log(&Ulog, bytes, &options);
}
