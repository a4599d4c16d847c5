//! A histogram of one latency.

use hdrhistogram::Histogram;
use shared_types::payload::LatencySummary;

/// A histogram of one latency: 1 ns to 100 s, three significant digits.
pub(crate) struct Latency(Histogram<u64>);

impl Latency {
    pub(crate) fn new() -> Self {
        Self(Histogram::new_with_bounds(1, 100_000_000_000, 3).expect("constant bounds"))
    }

    pub(crate) fn note(&mut self, value_ns: Option<u64>) {
        if let Some(value_ns) = value_ns {
            self.0.saturating_record(value_ns);
        }
    }

    pub(crate) fn summary(&self) -> LatencySummary {
        LatencySummary {
            count: self.0.len(),
            p50: self.0.value_at_quantile(0.5),
            p90: self.0.value_at_quantile(0.9),
            p99: self.0.value_at_quantile(0.99),
            p999: self.0.value_at_quantile(0.999),
            max: self.0.max(),
        }
    }
}
