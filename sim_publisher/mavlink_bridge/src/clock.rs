//! Converts times of the vehicle's clock to this machine's clock.
//!
//! A message has the time of its values by the vehicle's clock, and arrives after an unknown delay. Hence
//!
//! `offset = min over the last 10 s of (received − vehicle's time)`
//!
//! is the true offset plus the smallest delay in that time. Where the vehicle answers TIMESYNC, the exchange with the
//! shortest round trip in the last 10 s gives `offset = (sent + received) / 2 − vehicle's time`, with an error of at most
//! half that round trip. The smaller of both offsets is used, since no delay is negative. Clocks that drift apart by 50 ppm move the
//! smallest delay by 0.5 ms within the 10 s.
//!
//! Stamps never decrease: if the offset falls, they advance at no less than half of the vehicle's rate until they are right
//! again. A stamp is never later than the message's arrival.

/// Smallest delays and round trips are used for this long (ns).
const WINDOW_NS: u64 = 10_000_000_000;
const N_BUCKETS: usize = 10;
const BUCKET_NS: u64 = WINDOW_NS / N_BUCKETS as u64;
/// A time further behind the newest one than this, or ahead of the offset, is of a clock that was set anew (ns).
const RESET_NS: i128 = 1_000_000_000;
/// A round trip longer than this gives no better offset than the smallest delay (ns).
const MAX_ROUND_TRIP_NS: u64 = 200_000_000;

/// Whether the vehicle's clock continues.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Observed {
    /// As before.
    Steady,
    /// It was set anew, by a reboot for example: offsets begin from here.
    Reset,
}

#[derive(Debug, Clone, Copy)]
struct Exchange {
    offset_ns: i128,
    round_trip_ns: u64,
    at_ns: u64,
}

/// One of the vehicle's clocks (ns, any origin) against CLOCK_MONOTONIC.
#[derive(Debug, Clone, Default)]
pub struct VehicleClock {
    /// Smallest offset of each second, and which second.
    smallest: [Option<(u64, i128)>; N_BUCKETS],
    newest_vehicle_ns: Option<i128>,
    newest_receive_ns: u64,
    exchange: Option<Exchange>,
    /// The vehicle's time and ours of the newest stamp; the former is forgotten where the clock is set anew.
    stamped: (Option<i128>, u64),
}

impl VehicleClock {
    /// Uses a message that holds the vehicle's time and arrived at `receive_ns`.
    pub(crate) fn observe(&mut self, vehicle_ns: i128, receive_ns: u64) -> Observed {
        let backwards = self.newest_vehicle_ns.is_some_and(|newest| vehicle_ns < newest - RESET_NS);
        let ahead =
            self.offset_ns().is_some_and(|offset| vehicle_ns + offset > i128::from(receive_ns) + RESET_NS);
        let observed = if backwards || ahead { Observed::Reset } else { Observed::Steady };
        if observed == Observed::Reset {
            *self = Self { stamped: (None, self.stamped.1), ..Self::default() };
        }
        self.newest_vehicle_ns =
            Some(self.newest_vehicle_ns.map_or(vehicle_ns, |newest| newest.max(vehicle_ns)));
        self.newest_receive_ns = self.newest_receive_ns.max(receive_ns);
        let offset = i128::from(receive_ns) - vehicle_ns;
        let second = receive_ns / BUCKET_NS;
        let bucket = &mut self.smallest[(second % N_BUCKETS as u64) as usize];
        *bucket = match *bucket {
            Some((of, smallest)) if of == second => Some((of, smallest.min(offset))),
            _ => Some((second, offset)),
        };
        observed
    }

    /// Uses an answer to TIMESYNC, with the times of sending and receiving by our clock, and of the answer by the vehicle's.
    pub(crate) fn exchange(&mut self, sent_ns: u64, vehicle_ns: i128, received_ns: u64) {
        let Some(round_trip_ns) = received_ns.checked_sub(sent_ns) else { return };
        let middle_ns = sent_ns + round_trip_ns / 2;
        let new =
            Exchange { offset_ns: i128::from(middle_ns) - vehicle_ns, round_trip_ns, at_ns: received_ns };
        let kept = self.exchange.filter(|kept| {
            kept.round_trip_ns < round_trip_ns && received_ns.saturating_sub(kept.at_ns) < WINDOW_NS
        });
        if round_trip_ns < MAX_ROUND_TRIP_NS {
            self.exchange = kept.or(Some(new));
        }
    }

    fn smallest_ns(&self) -> Option<i128> {
        let now = self.newest_receive_ns / BUCKET_NS;
        let recent = self.smallest.iter().flatten().filter(|(second, _)| second + N_BUCKETS as u64 > now);
        recent.map(|(_, offset)| *offset).min()
    }

    /// The exchange in use: recent, and of the same clock as the messages' times.
    fn usable_exchange(&self) -> Option<Exchange> {
        let smallest = self.smallest_ns()?;
        self.exchange.filter(|exchange| {
            self.newest_receive_ns.saturating_sub(exchange.at_ns) < 3 * WINDOW_NS
                && (exchange.offset_ns - smallest).abs() < RESET_NS
        })
    }

    /// Our time less the vehicle's (ns).
    pub(crate) fn offset_ns(&self) -> Option<i128> {
        let smallest = self.smallest_ns()?;
        Some(self.usable_exchange().map_or(smallest, |exchange| exchange.offset_ns.min(smallest)))
    }

    /// Of the TIMESYNC exchange in use (ns).
    pub fn round_trip_ns(&self) -> Option<u64> {
        Some(self.usable_exchange()?.round_trip_ns)
    }

    /// CLOCK_MONOTONIC of a time that was observed; `None` where it is not later than the one stamped before.
    pub(crate) fn stamp_ns(&mut self, vehicle_ns: i128) -> Option<u64> {
        let mut stamp_ns = vehicle_ns + self.offset_ns()?;
        let (stamped_vehicle_ns, stamped_ns) = self.stamped;
        if let Some(before_ns) = stamped_vehicle_ns {
            if vehicle_ns <= before_ns {
                return None;
            }
            stamp_ns = stamp_ns.max(i128::from(stamped_ns) + (vehicle_ns - before_ns) / 2);
        }
        let stamp_ns = u64::try_from(stamp_ns.min(i128::from(self.newest_receive_ns))).ok()?;
        if stamp_ns <= stamped_ns {
            return None;
        }
        self.stamped = (Some(vehicle_ns), stamp_ns);
        Some(stamp_ns)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const MS: u64 = 1_000_000;
    const S: u64 = 1_000 * MS;
    /// Our time when the vehicle's was zero.
    const BOOT_NS: u64 = 1_000 * S;

    /// A message taken at `vehicle_ns` and delayed; its stamp less the true time.
    fn error_ns(clock: &mut VehicleClock, vehicle_ns: u64, delay_ns: u64) -> Option<i64> {
        clock.observe(vehicle_ns.into(), BOOT_NS + vehicle_ns + delay_ns);
        clock.stamp_ns(vehicle_ns.into()).map(|stamp| stamp as i64 - (BOOT_NS + vehicle_ns) as i64)
    }

    #[test]
    fn stamps_are_late_by_the_smallest_delay_alone() {
        let mut clock = VehicleClock::default();
        for k in 0..2000 {
            // 2 ms, and up to 9 more.
            let error = error_ns(&mut clock, k * 5 * MS, 2 * MS + (k * 7) % 10 * MS).unwrap();
            assert!(k < 10 || error == 2 * MS as i64, "{k}: {error}");
        }
    }

    #[test]
    fn an_exchange_of_times_takes_the_delay_away_within_half_its_round_trip() {
        let mut clock = VehicleClock::default();
        let mut error = 0;
        for k in 0..4000u64 {
            let now_ns = k * 5 * MS;
            error = error_ns(&mut clock, now_ns, 8 * MS).unwrap();
            if k % 20 == 0 {
                // There in 1 ms, back in 3.
                let sent_ns = BOOT_NS + now_ns;
                clock.exchange(sent_ns, (now_ns + MS).into(), sent_ns + 4 * MS);
            }
        }
        assert_eq!((error, clock.round_trip_ns()), (MS as i64, Some(4 * MS)));
        // One of another clock, a UNIX time say, is not used; nor one that took too long.
        let mut other = VehicleClock::default();
        error_ns(&mut other, 0, 8 * MS);
        other.exchange(BOOT_NS, 1_700_000_000 * i128::from(S), BOOT_NS + MS);
        assert_eq!(other.round_trip_ns(), None);
        other.exchange(BOOT_NS, 0, BOOT_NS + S);
        assert_eq!(other.round_trip_ns(), None);
    }

    #[test]
    fn a_drifting_clock_is_followed() {
        let mut clock = VehicleClock::default();
        for k in 0..100 * 200u64 {
            let true_ns = k * 5 * MS;
            let vehicle_ns = i128::from(true_ns) - i128::from(true_ns) / 20_000;
            clock.observe(vehicle_ns, BOOT_NS + true_ns);
            let error_ns = clock.stamp_ns(vehicle_ns).unwrap() as i64 - (BOOT_NS + true_ns) as i64;
            // 50 ppm of the 10 s for which the smallest delay counts.
            assert!((-(MS as i64) / 2 - 1..=0).contains(&error_ns), "{k}: {error_ns}");
        }
    }

    #[test]
    fn a_reboot_and_a_jump_ahead_begin_a_new_offset_and_time_goes_on() {
        let mut clock = VehicleClock::default();
        error_ns(&mut clock, 60 * S, 2 * MS);
        let now_ns = BOOT_NS + 61 * S;
        assert_eq!(clock.observe((S / 2).into(), now_ns), Observed::Reset);
        assert_eq!(clock.stamp_ns((S / 2).into()), Some(now_ns));
        assert_eq!(clock.observe((S / 2 + 5 * MS).into(), now_ns + 5 * MS), Observed::Steady);
        // A UNIX time from now on.
        let unix_ns = 1_700_000_000 * i128::from(S);
        assert_eq!(clock.observe(unix_ns, now_ns + 10 * MS), Observed::Reset);
        assert_eq!(clock.stamp_ns(unix_ns), Some(now_ns + 10 * MS));
        // Within a second it is a message that was overtaken.
        assert_eq!(clock.observe(unix_ns - 500 * i128::from(MS), now_ns + 11 * MS), Observed::Steady);
        assert_eq!(clock.stamp_ns(unix_ns - 500 * i128::from(MS)), None);
    }

    #[test]
    fn a_smaller_offset_is_approached_at_half_pace() {
        let mut clock = VehicleClock::default();
        assert_eq!(error_ns(&mut clock, 0, 100 * MS), Some(100 * MS as i64));
        // Now it is known that this was all delay.
        clock.exchange(BOOT_NS + 100 * MS, (101 * MS).into(), BOOT_NS + 102 * MS);
        for k in 1..40 {
            let expected = (100 - 5 * k as i64).max(0) * MS as i64;
            assert_eq!(error_ns(&mut clock, k * 10 * MS, 100 * MS), Some(expected));
        }
    }

    #[test]
    fn a_burst_after_a_stalled_line_keeps_its_own_times() {
        let mut clock = VehicleClock::default();
        for k in 0..100 {
            error_ns(&mut clock, k * 10 * MS, MS).unwrap();
        }
        for k in 100..400 {
            // All at once, at 4 s.
            clock.observe((k * 10 * MS).into(), BOOT_NS + 4 * S);
            assert_eq!(clock.stamp_ns((k * 10 * MS).into()), Some(BOOT_NS + k * 10 * MS + MS), "{k}");
        }
    }

    proptest! {
        #[test]
        fn whatever_the_times_are_stamps_grow_and_are_never_later_than_the_arrival(
            times in prop::collection::vec((any::<u64>(), 0..3 * S, any::<bool>()), 1..200)
        ) {
            let mut clock = VehicleClock::default();
            let (mut now_ns, mut newest_ns, mut vehicle_ns) = (BOOT_NS, 0, 0);
            for (any_ns, step_ns, steady) in times {
                now_ns += step_ns;
                vehicle_ns = if steady { vehicle_ns + i128::from(step_ns) } else { i128::from(any_ns) * 1000 };
                clock.observe(vehicle_ns, now_ns);
                if step_ns % 3 == 0 {
                    clock.exchange(now_ns.saturating_sub(any_ns % S), vehicle_ns, now_ns);
                }
                if let Some(stamp_ns) = clock.stamp_ns(vehicle_ns) {
                    prop_assert!(stamp_ns > newest_ns && stamp_ns <= now_ns);
                    newest_ns = stamp_ns;
                }
            }
        }
    }
}
