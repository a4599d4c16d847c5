//! The clocks of the sensors whose stamps are not of CLOCK_MONOTONIC: a sample's stamp becomes one of it as the sample is received,
//! before it is recorded, so that a replay sees the same stamps.

use crate::config::{SensorClock, SensorConfig};
use shared_types::Measurement;
use shared_types::clock::{SenderClock, monotonic_ns, realtime_ns};

const N: usize = observer::MAX_SENSORS;

/// CLOCK_MONOTONIC minus the clock of each sensor (ns), by its number; `None` where that is CLOCK_MONOTONIC, or not known yet.
pub type ClockOffsets = [Option<i64>; N];

#[derive(Debug, Clone, Copy)]
enum Offset {
    Realtime,
    /// The least of arrival minus stamp.
    Own(SenderClock),
}

/// Each sensor's clock.
#[derive(Debug, Clone, Default)]
pub struct SensorClocks {
    of_number: [Option<Offset>; N],
    known: ClockOffsets,
}

impl SensorClocks {
    /// Those of a configuration that is checked.
    pub fn new(sensors: &[SensorConfig]) -> Self {
        let mut clocks = Self::default();
        for sensor in sensors {
            if let Some(place) = clocks.of_number.get_mut(sensor.number as usize) {
                *place = match sensor.clock {
                    SensorClock::Monotonic => None,
                    SensorClock::Realtime => Some(Offset::Realtime),
                    SensorClock::Own => Some(Offset::Own(SenderClock::default())),
                };
            }
        }
        clocks
    }

    /// The sample that arrived at `arrival_ns` with its stamp on CLOCK_MONOTONIC.
    pub fn on_our_clock(&mut self, measurement: Measurement, arrival_ns: u64) -> Measurement {
        let number = measurement.sensor as usize;
        let Some(Some(clock)) = self.of_number.get_mut(number) else { return measurement };
        let offset_ns = match clock {
            // Read for each sample: the system's clock may be set at any time.
            Offset::Realtime => monotonic_ns().wrapping_sub(realtime_ns()) as i64,
            Offset::Own(clock) => {
                clock.note(measurement.stamp_ns, arrival_ns);
                clock.offset_ns().unwrap_or(0)
            }
        };
        self.known[number] = Some(offset_ns);
        Measurement { stamp_ns: measurement.stamp_ns.saturating_add_signed(offset_ns), ..measurement }
    }

    /// What was found.
    pub fn offsets_ns(&self) -> &ClockOffsets {
        &self.known
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const S: u64 = 1_000_000_000;
    const MS: u64 = S / 1000;

    fn clocks(clock: &str) -> SensorClocks {
        let text = format!("name = \"gnss\"\nnumber = 4\nclock = \"{clock}\"");
        SensorClocks::new(&[toml::from_str(&text).unwrap()])
    }

    #[test]
    fn a_clock_of_its_own_is_ours_but_for_the_shortest_delay() {
        let mut clocks = clocks("own");
        let mut read = |theirs_ms: u64, arrival_ms: u64| {
            let sample = Measurement::at(700 * S + theirs_ms * MS, 0).of_sensor(4);
            clocks.on_our_clock(sample, 20 * S + arrival_ms * MS).stamp_ns
        };
        // Delays of 9, 3 and 30 ms.
        assert_eq!(read(0, 9), 20 * S + 9 * MS);
        assert_eq!(read(5, 8), 20 * S + 8 * MS);
        assert_eq!(read(10, 40), 20 * S + 13 * MS);
        // Their machine was started anew.
        let sample = Measurement::at(S, 0).of_sensor(4);
        assert_eq!(clocks.on_our_clock(sample, 30 * S).stamp_ns, 30 * S);
        assert_eq!(clocks.offsets_ns()[4], Some(29 * S as i64));
    }

    #[test]
    fn the_time_of_day_is_ours_within_a_millisecond() {
        let mut clocks = clocks("realtime");
        let (sample, now_ns) = (Measurement::at(realtime_ns(), 0).of_sensor(4), monotonic_ns());
        let read = clocks.on_our_clock(sample, now_ns);
        assert!(read.stamp_ns.abs_diff(now_ns) < MS, "{} {now_ns}", read.stamp_ns);
        let other = Measurement::at(5, 0).of_sensor(3);
        assert_eq!(clocks.on_our_clock(other, now_ns), other);
    }
}
