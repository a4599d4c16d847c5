//! The vehicle's clock on ours.
//!
//! A message says when, by the vehicle's clock, its values held; it arrives later by an unknown delay. So
//!
//! `offset = min over the last 10 s of (received − vehicle's time)`
//!
//! is the true offset plus the smallest delay in that time. Where the vehicle answers TIMESYNC, the exchange with the
//! shortest round trip in the last 10 s gives `offset = (sent + received) / 2 − vehicle's time`, wrong by half that round
//! trip at most; the smaller of both is taken, for no delay is negative. Clocks that drift apart by 50 ppm move the
//! smallest delay by 0.5 ms within the 10 s.
//!
//! Stamps only ever grow: where the offset falls, they run at no less than half of the vehicle's pace until they are right.
//! They are never later than the message's arrival.

/// Smallest delays and round trips count for so long (ns).
const WINDOW_NS: u64 = 10_000_000_000;
const N_BUCKETS: usize = 10;
const BUCKET_NS: u64 = WINDOW_NS / N_BUCKETS as u64;
/// A time so far behind the newest one, or ahead of the offset, is of a clock that was set anew (ns).
const RESET_NS: i128 = 1_000_000_000;
/// A round trip as long as this tells nothing that the smallest delay does not (ns).
const LONGEST_ROUND_TRIP_NS: u64 = 200_000_000;

/// Whether the vehicle's clock goes on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Observed {
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
    /// Takes notice of a message that holds the vehicle's time and arrived at `receive_ns`.
    pub fn observe(&mut self, vehicle_ns: i128, receive_ns: u64) -> Observed {
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

    /// Takes notice of an answer to TIMESYNC: sent and received by our clock, answered by the vehicle's.
    pub fn exchange(&mut self, sent_ns: u64, vehicle_ns: i128, received_ns: u64) {
        let Some(round_trip_ns) = received_ns.checked_sub(sent_ns) else { return };
        let middle_ns = sent_ns + round_trip_ns / 2;
        let new =
            Exchange { offset_ns: i128::from(middle_ns) - vehicle_ns, round_trip_ns, at_ns: received_ns };
        let kept = self.exchange.filter(|kept| {
            kept.round_trip_ns < round_trip_ns && received_ns.saturating_sub(kept.at_ns) < WINDOW_NS
        });
        if round_trip_ns < LONGEST_ROUND_TRIP_NS {
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
    pub fn offset_ns(&self) -> Option<i128> {
        let smallest = self.smallest_ns()?;
        Some(self.usable_exchange().map_or(smallest, |exchange| exchange.offset_ns.min(smallest)))
    }

    /// Of the TIMESYNC exchange in use (ns).
    pub fn round_trip_ns(&self) -> Option<u64> {
        Some(self.usable_exchange()?.round_trip_ns)
    }

    /// CLOCK_MONOTONIC of a time that was observed; `None` where it is not later than the one stamped before.
    pub fn stamp_ns(&mut self, vehicle_ns: i128) -> Option<u64> {
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
