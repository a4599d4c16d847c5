//! The history of a quantity over the last minutes, in buckets of a second; the histogram of a latency.

use std::collections::VecDeque;

/// Length of a bucket (ns).
pub const BUCKET_NS: u64 = 1_000_000_000;
/// Buckets that are kept: five minutes.
pub const BUCKETS: usize = 300;

/// The mean of one quantity per bucket; `None` where nothing came, and where it was not finite.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct History {
    means: VecDeque<Option<f64>>,
    sum: f64,
    count: u32,
    bucket: u64,
}

impl History {
    /// Adds a value at an instant. A value older than the newest bucket is left out.
    pub fn note(&mut self, at_ns: u64, value: f64) {
        self.go_on_to(at_ns / BUCKET_NS);
        if at_ns / BUCKET_NS == self.bucket && value.is_finite() {
            self.sum += value;
            self.count += 1;
        }
    }

    fn go_on_to(&mut self, bucket: u64) {
        if self.means.is_empty() && self.count == 0 {
            self.bucket = self.bucket.max(bucket);
        }
        let missed = bucket.saturating_sub(self.bucket);
        if missed == 0 {
            return;
        }
        self.means.push_back(self.newest());
        let gap = (missed - 1).min(BUCKETS as u64) as usize;
        self.means.extend(std::iter::repeat_n(None, gap));
        while self.means.len() > BUCKETS {
            self.means.pop_front();
        }
        (self.sum, self.count, self.bucket) = (0.0, 0, bucket);
    }

    fn newest(&self) -> Option<f64> {
        (self.count > 0).then(|| self.sum / f64::from(self.count))
    }

    /// The last `n` buckets until `now_ns`, oldest first, the unfinished one last.
    pub fn last(&self, n: usize, now_ns: u64) -> Vec<Option<f64>> {
        let silent = ((now_ns / BUCKET_NS).saturating_sub(self.bucket) as usize).min(n);
        let newest_first = std::iter::repeat_n(None, silent)
            .chain([self.newest()])
            .chain(self.means.iter().rev().copied())
            .chain(std::iter::repeat(None));
        let mut last: Vec<_> = newest_first.take(n).collect();
        last.reverse();
        last
    }
}

/// A histogram of latencies from 1 µs to 10 s, with eight bins per decade. Values outside are in the end bins.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Histogram {
    /// Values in each bin.
    pub counts: [u64; Self::BINS],
}

impl Default for Histogram {
    fn default() -> Self {
        Self { counts: [0; Self::BINS] }
    }
}

impl Histogram {
    /// Bins of each power of ten.
    pub const BINS_PER_DECADE: usize = 8;
    /// All bins.
    pub const BINS: usize = 7 * Self::BINS_PER_DECADE;

    /// Counts a latency.
    pub fn note(&mut self, latency_ns: u64) {
        let decades = (latency_ns as f64 / 1e3).log10().max(0.0);
        let bin = (decades * Self::BINS_PER_DECADE as f64) as usize;
        self.counts[bin.min(Self::BINS - 1)] += 1;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn buckets_hold_means_and_gaps_stay_gaps() {
        let mut history = History::default();
        let at = |bucket: u64| 1000 * BUCKET_NS + bucket * BUCKET_NS + 7;
        for (bucket, value) in [(0, 1.0), (0, 3.0), (1, 5.0), (4, f64::NAN), (4, 7.0), (3, 100.0)] {
            history.note(at(bucket), value);
        }
        assert_eq!(history.last(6, at(4)), [None, Some(2.0), Some(5.0), None, None, Some(7.0)]);
        assert_eq!(history.last(3, at(6)), [Some(7.0), None, None]);
        assert_eq!(history.last(2, at(1_000_000)), [None, None]);
    }

    #[test]
    fn no_more_is_kept_than_is_shown() {
        let mut history = History::default();
        for bucket in 0..3 * BUCKETS as u64 {
            history.note(bucket * BUCKET_NS, bucket as f64);
        }
        assert_eq!(history.means.len(), BUCKETS);
        history.note(u64::MAX, 0.0);
        assert_eq!(history.means.len(), BUCKETS);
        assert_eq!(history.last(BUCKETS, u64::MAX).len(), BUCKETS);
    }

    #[test]
    fn latencies_are_counted_by_their_size() {
        let mut histogram = Histogram::default();
        for latency_ns in [0, 1_000, 9_999, 10_001, 1_000_100, 9_999_999_999, u64::MAX] {
            histogram.note(latency_ns);
        }
        let filled: Vec<_> = histogram.counts.iter().enumerate().filter(|(_, count)| **count > 0).collect();
        assert_eq!(filled, [(0, &2), (7, &1), (8, &1), (24, &1), (55, &2)]);
    }
}
