//! What each source has sent, for people: rates, delays, counts. No estimate depends on it.

use shared_types::payload::Measurement;
use shared_types::service::MAX_SOURCES;

/// The usual period follows the periods by this much of their difference.
const PERIOD_RATE: f64 = 1.0 / 16.0;
/// The mean of the innovations follows them by this much.
const NIS_RATE: f64 = 1.0 / 32.0;
/// The median follows the delays by this part of itself for each sample.
const MEDIAN_RATE: f64 = 0.02;

/// What one source has sent.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SourceRow {
    /// Its publisher.
    pub source: u128,
    /// Number of its sensor in its newest sample; 0: none.
    pub sensor: u32,
    /// When its newest sample was taken from the queue (ns).
    pub arrival_ns: u64,
    /// The usual time between two (ns); 0 before the second.
    pub period_ns: f64,
    /// Median of the delays from stamp to arrival (ns), which follows them slowly; negative for stamps ahead of the clock.
    pub delay_ns: f64,
    /// The largest delay (ns).
    pub max_delay_ns: u64,
    /// Samples used.
    pub accepted: u64,
    /// Of these, how many had an older stamp than the newest one of all sources.
    pub late: u64,
    /// Gaps in its sequence.
    pub lost: u64,
    /// Samples rejected.
    pub rejected: u64,
    /// Recent mean of the normalized innovation squared of its velocities; 0 where it has none.
    pub nis: f64,
}

/// How a sample of a source was received.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Received {
    /// Used; whether it is older than the newest one, and the change of the count of lost ones.
    Accepted {
        /// Whether its stamp is not the newest of all.
        is_late: bool,
        /// Of the gap before it; −1 where it was counted as lost before.
        lost: i64,
    },
    /// Not used.
    Rejected,
}

/// The rows of all sources; of more than there is room for, those that sent last.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct SourceBook {
    rows: [Option<SourceRow>; MAX_SOURCES],
}

impl SourceBook {
    /// The rows, in the order of the sources' appearance.
    pub fn rows(&self) -> impl Iterator<Item = &SourceRow> {
        self.rows.iter().flatten()
    }

    /// Notes a sample that was taken from the queue at `now_ns`.
    pub fn note(&mut self, measurement: &Measurement, source: u128, now_ns: u64, received: Received) {
        let place = self.place_of(source);
        let delay_ns = now_ns as f64 - measurement.stamp_ns as f64;
        let first = SourceRow {
            source,
            sensor: measurement.sensor,
            arrival_ns: now_ns,
            period_ns: 0.0,
            delay_ns,
            max_delay_ns: 0,
            accepted: 0,
            late: 0,
            lost: 0,
            rejected: 0,
            nis: 0.0,
        };
        let before = self.rows[place].filter(|row| row.source == source);
        let row = self.rows[place].insert(before.unwrap_or(first));
        if before.is_some() {
            let period_ns = now_ns.saturating_sub(row.arrival_ns) as f64;
            let rate = if row.period_ns == 0.0 { 1.0 } else { PERIOD_RATE };
            row.period_ns += rate * (period_ns - row.period_ns);
            let step_ns = MEDIAN_RATE * row.delay_ns.abs().max(1e3);
            row.delay_ns += (delay_ns - row.delay_ns).clamp(-step_ns, step_ns);
        }
        (row.sensor, row.arrival_ns) = (measurement.sensor, now_ns);
        row.max_delay_ns = row.max_delay_ns.max(delay_ns.max(0.0) as u64);
        match received {
            Received::Rejected => row.rejected += 1,
            Received::Accepted { is_late, lost } => {
                row.accepted += 1;
                row.late += u64::from(is_late);
                row.lost = row.lost.saturating_add_signed(lost);
            }
        }
    }

    /// Notes how a velocity of a source agreed.
    pub fn note_nis(&mut self, source: u128, nis: f64) {
        if let Some(row) = self.rows.iter_mut().flatten().find(|row| row.source == source) {
            row.nis += if row.nis == 0.0 { nis } else { NIS_RATE * (nis - row.nis) };
        }
    }

    fn place_of(&self, source: u128) -> usize {
        let is_own = |row: &Option<SourceRow>| row.is_some_and(|row| row.source == source);
        let known = self.rows.iter().position(is_own).or_else(|| self.rows.iter().position(Option::is_none));
        let oldest = || {
            let arrivals = self.rows.iter().map(|row| row.map(|row| row.arrival_ns));
            arrivals.enumerate().min_by_key(|(_, arrival)| *arrival).map_or(0, |(place, _)| place)
        };
        known.unwrap_or_else(oldest)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rate_delay_and_counts_are_those_of_what_came() {
        let mut book = SourceBook::default();
        let mut seed = 5_u64;
        for j in 0..2000_u64 {
            seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            let (stamp_ns, jitter_ns) = (1_000_000_000 + j * 200_000_000, seed >> 39);
            let sample = Measurement::at(stamp_ns, j).of_sensor(2);
            let received = match j % 100 {
                0 => Received::Rejected,
                1 => Received::Accepted { is_late: true, lost: 3 },
                2 => Received::Accepted { is_late: false, lost: -1 },
                _ => Received::Accepted { is_late: false, lost: 0 },
            };
            book.note(&sample, 9, stamp_ns + 150_000_000 + jitter_ns, received);
        }
        let rows: Vec<_> = book.rows().collect();
        let row = rows[0];
        assert_eq!((rows.len(), row.sensor, row.accepted, row.late), (1, 2, 1980, 20));
        assert_eq!((row.lost, row.rejected), (40, 20));
        assert!((row.period_ns / 2e8 - 1.0).abs() < 0.05, "{row:?}");
        // The jitter is even, up to 2²⁵ ns.
        assert!((row.delay_ns - 1.668e8).abs() < 8e6, "{row:?}");
        assert!((170_000_000..184_000_000).contains(&row.max_delay_ns), "{row:?}");
    }

    #[test]
    fn of_too_many_sources_those_that_sent_last_have_a_row() {
        let mut book = SourceBook::default();
        for source in 0..40_u64 {
            let sample = Measurement::at(source, 0);
            book.note(&sample, source.into(), source + 1, Received::Rejected);
        }
        let mut sources: Vec<_> = book.rows().map(|row| row.source).collect();
        sources.sort_unstable();
        assert_eq!(sources, (24..40).collect::<Vec<u128>>());
    }
}
