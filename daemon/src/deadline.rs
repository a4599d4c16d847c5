//! Waiting for a deadline, and moving to the next one.

use shared_types::clock::{monotonic_ns, sleep_until_ns};

/// A tick of the timer: when it was due, and when the loop woke.
#[derive(Debug, Clone, Copy)]
pub struct WakeUp {
    /// When the loop woke (ns).
    pub wake_ns: u64,
    /// When it should have woken (ns); `None` if a sample woke it.
    pub deadline_ns: Option<u64>,
}

/// Moves a deadline to the next one of its grid that has not passed, and counts those that have.
pub fn skip_missed(deadline_ns: &mut u64, now_ns: u64, period_ns: u64) -> u64 {
    *deadline_ns += period_ns;
    let missed = match now_ns.checked_sub(*deadline_ns) {
        Some(late_ns) if late_ns > 0 => late_ns / period_ns + 1,
        _ => 0,
    };
    *deadline_ns += missed * period_ns;
    missed
}

/// Sleeps to `spin_ns` before the deadline and polls the clock for the rest.
pub fn wait_for_deadline(deadline_ns: u64, spin_ns: u64) -> WakeUp {
    let sleep_end_ns = deadline_ns.saturating_sub(spin_ns);
    loop {
        let now_ns = monotonic_ns();
        if now_ns >= deadline_ns {
            return WakeUp { wake_ns: now_ns, deadline_ns: Some(deadline_ns) };
        }
        if now_ns < sleep_end_ns {
            sleep_until_ns(sleep_end_ns);
        } else {
            std::hint::spin_loop();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::skip_missed;

    #[test]
    fn late_ticks_are_counted_and_skipped_over() {
        for (now_ns, next_ns, misses) in [
            (1010, 1100, 0),
            (1100, 1100, 0),
            (1101, 1200, 1),
            (1199, 1200, 1),
            (1201, 1300, 2),
            (9950, 10_000, 89),
        ] {
            let mut deadline_ns = 1000;
            assert_eq!(skip_missed(&mut deadline_ns, now_ns, 100), misses, "at {now_ns}");
            assert_eq!(deadline_ns, next_ns, "at {now_ns}");
        }
    }
}
