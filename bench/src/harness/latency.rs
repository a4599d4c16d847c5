//! Quantiles of latencies, and their columns in tables.

use super::output::{microseconds, table};
use comfy_table::Table;
use shared_types::LatencySummary;

/// The smallest sample that a share `q` of all samples does not exceed (nearest rank).
///
/// # Panics
/// Without samples.
pub(crate) fn quantile(sorted: &[u64], q: f64) -> u64 {
    let rank = (q * sorted.len() as f64).ceil() as usize;
    sorted[rank.clamp(1, sorted.len()) - 1]
}

/// Sorts the samples and returns their quantiles; `None` without samples.
pub(crate) fn summary(samples_ns: &mut [u64]) -> Option<LatencySummary> {
    samples_ns.sort_unstable();
    let quantile = |q: f64| quantile(samples_ns, q);
    (!samples_ns.is_empty()).then(|| LatencySummary {
        count: samples_ns.len() as u64,
        p50: quantile(0.5),
        p90: quantile(0.9),
        p99: quantile(0.99),
        p999: quantile(0.999),
        max: quantile(1.0),
    })
}

/// What [`cells`] holds.
pub(crate) const HEADER: [&str; 6] = ["count", "p50", "p90", "p99", "p99.9", "max"];

/// Latencies by name, in µs, under this title.
pub(crate) fn latency_table<const N: usize>(title: &str, rows: [(&str, LatencySummary); N]) -> Table {
    let rows = rows.map(|(name, found)| [vec![name.to_owned()], cells(Some(found)).to_vec()].concat());
    table(&[[title].as_slice(), &HEADER].concat(), 1, rows)
}

/// A row's cells, in µs; dashes where nothing was measured.
pub(crate) fn cells(summary: Option<LatencySummary>) -> [String; 6] {
    summary.map_or_else(
        || std::array::from_fn(|_| "–".into()),
        |LatencySummary { count, p50, p90, p99, p999, max }| {
            let [p50, p90, p99, p999, max] = [p50, p90, p99, p999, max].map(microseconds);
            [count.to_string(), p50, p90, p99, p999, max]
        },
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    /// With 1…1000, a share q of the samples does not exceed 1000 q.
    #[test]
    fn quantiles_are_samples_of_the_nearest_rank() {
        let mut samples: Vec<u64> = (1..=1000).rev().collect();
        let LatencySummary { count, p50, p90, p99, p999, max } = summary(&mut samples).unwrap();
        assert_eq!([count, p50, p90, p99, p999, max], [1000, 500, 900, 990, 999, 1000]);
        assert_eq!([0.0, 0.001, 0.0011].map(|q| quantile(&samples, q)), [1, 1, 2]);
        assert_eq!(quantile(&[1, 9], 0.5), 1);
        assert_eq!(summary(&mut []), None);
    }
}
