//! The clock of every time stamp: CLOCK_MONOTONIC, in nanoseconds.

use rustix::thread::clock_nanosleep_absolute;
use rustix::time::{ClockId, Timespec, clock_gettime};

const NS_PER_S: u64 = 1_000_000_000;

/// Nanoseconds of CLOCK_MONOTONIC now. No system call where the kernel offers the vDSO.
pub fn monotonic_ns() -> u64 {
    let now = clock_gettime(ClockId::Monotonic);
    now.tv_sec as u64 * NS_PER_S + now.tv_nsec as u64
}

/// Nanoseconds of CLOCK_REALTIME now, the time of day since 1970.
pub fn realtime_ns() -> u64 {
    let now = clock_gettime(ClockId::Realtime);
    now.tv_sec as u64 * NS_PER_S + now.tv_nsec as u64
}

/// Sleeps until CLOCK_MONOTONIC reaches `deadline_ns`; returns early when a signal arrives.
pub fn sleep_until_ns(deadline_ns: u64) {
    let deadline =
        Timespec { tv_sec: (deadline_ns / NS_PER_S) as i64, tv_nsec: (deadline_ns % NS_PER_S) as _ };
    // The only possible error is an interruption: the caller looks at the clock again.
    let _ = clock_nanosleep_absolute(ClockId::Monotonic, &deadline);
}

/// The least offset is sought over two of these: clocks drift apart by milliseconds meanwhile, at most (ns).
const SPAN_NS: u64 = 60 * NS_PER_S;
/// Stamps that decrease by more come from a clock that was started anew (ns).
const BACK_NS: u64 = NS_PER_S;

/// The CLOCK_MONOTONIC of another machine, estimated from the stamps of its messages.
///
/// `offset = min over the last one to two minutes of (arrival − stamp)`
///
/// This is the offset of the two clocks plus the shortest delay of a message; one side alone cannot distinguish the two. An
/// age computed with it is therefore the time *beyond* that shortest delay.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct SenderClock {
    /// Our clock minus the sender's (ns): the least of the previous span and of this one.
    least_ns: [Option<i64>; 2],
    span_end_ns: u64,
    newest_stamp_ns: u64,
}

impl SenderClock {
    /// Uses the stamp of a message. Returns true if its machine has started its clock anew, as at a reboot.
    pub fn note(&mut self, stamp_ns: u64, arrival_ns: u64) -> bool {
        let is_anew = stamp_ns.saturating_add(BACK_NS) < self.newest_stamp_ns;
        if is_anew {
            *self = Self::default();
        }
        self.newest_stamp_ns = self.newest_stamp_ns.max(stamp_ns);
        if arrival_ns >= self.span_end_ns {
            self.least_ns = [self.least_ns[1], None];
            self.span_end_ns = arrival_ns.saturating_add(SPAN_NS);
        }
        let offset_ns = arrival_ns.wrapping_sub(stamp_ns) as i64;
        self.least_ns[1] = Some(self.least_ns[1].map_or(offset_ns, |least_ns| least_ns.min(offset_ns)));
        is_anew
    }

    /// What that clock shows when ours shows `now_ns`; ours as it is before the first message.
    pub fn at(&self, now_ns: u64) -> u64 {
        now_ns.saturating_add_signed(self.offset_ns().unwrap_or(0).saturating_neg())
    }

    /// Our clock minus that one (ns), with the shortest delay; `None` before the first message.
    pub fn offset_ns(&self) -> Option<i64> {
        self.least_ns.into_iter().flatten().min()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const S: u64 = NS_PER_S;
    const MS: u64 = S / 1000;

    #[test]
    fn ages_count_from_the_shortest_way_whatever_separates_the_clocks() {
        for (ours_ns, theirs_ns) in [(1000 * S, 9_000_000 * S), (9_000_000 * S, 1000 * S), (S, S)] {
            let mut clock = SenderClock::default();
            assert_eq!(clock.at(ours_ns), ours_ns);
            for (sent_ms, way_ms) in [(0, 9), (5, 3), (10, 30)] {
                assert!(!clock.note(theirs_ns + sent_ms * MS, ours_ns + (sent_ms + way_ms) * MS));
            }
            // The message sent at 10 ms is, at 40 ms, 30 ms old; 27 more than the shortest way.
            assert_eq!(clock.at(ours_ns + 40 * MS) - (theirs_ns + 10 * MS), 27 * MS);
        }
    }

    #[test]
    fn a_drift_is_followed_within_two_minutes_and_a_reboot_at_once() {
        let mut clock = SenderClock::default();
        // Theirs is slow by a part in a thousand: 0.36 s fall behind within six minutes.
        let sent = |after_s: u64| 500 * S + after_s * 999 * MS;
        for after_s in 0..360 {
            assert!(!clock.note(sent(after_s), 1000 * S + after_s * S));
        }
        let seen_ns = clock.at(1000 * S + 359 * S).abs_diff(sent(359));
        assert!(seen_ns <= 2 * SPAN_NS / 1000, "{seen_ns}");
        assert!(clock.note(20 * S, 1400 * S), "it has started anew");
        assert_eq!(clock.at(1401 * S), 21 * S);
    }
}
