//! The clock of every time stamp: CLOCK_MONOTONIC, in nanoseconds.

use rustix::thread::clock_nanosleep_absolute;
use rustix::time::{ClockId, Timespec, clock_gettime};

const NS_PER_S: u64 = 1_000_000_000;

/// Nanoseconds of CLOCK_MONOTONIC now. No system call where the kernel offers the vDSO.
pub fn monotonic_ns() -> u64 {
    let now = clock_gettime(ClockId::Monotonic);
    now.tv_sec as u64 * NS_PER_S + now.tv_nsec as u64
}

/// Sleeps until CLOCK_MONOTONIC reaches `deadline_ns`; returns early when a signal arrives.
pub fn sleep_until_ns(deadline_ns: u64) {
    let deadline =
        Timespec { tv_sec: (deadline_ns / NS_PER_S) as i64, tv_nsec: (deadline_ns % NS_PER_S) as _ };
    // The only possible error is an interruption: the caller looks at the clock again.
    let _ = clock_nanosleep_absolute(ClockId::Monotonic, &deadline);
}
