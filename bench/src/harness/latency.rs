//! Latencies: quantiles, histograms, and how tables show them.

use super::output::microseconds;
use serde::Serialize;
use shared_types::LatencySummary;

/// The smallest sample that a share `q` of all samples does not exceed (nearest rank).
///
/// # Panics
/// Without samples.
pub(crate) fn quantile(sorted: &[u64], q: f64) -> u64 {
    let rank = (q * sorted.len() as f64).ceil() as usize;
    sorted[rank.clamp(1, sorted.len()) - 1]
}

/// Sorts the samples, and tells their quantiles; `None` without samples.
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

/// Samples from `from_ns` on and below `to_ns`.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub(crate) struct Bin {
    pub(crate) from_ns: u64,
    pub(crate) to_ns: u64,
    pub(crate) count: u64,
}

/// Counts by magnitude, in bins of 1, 2, 5, 10 … from the smallest sample's to the largest's.
pub(crate) fn histogram(samples_ns: &[u64]) -> Vec<Bin> {
    let edges = (0..).flat_map(|decade| [1, 2, 5].map(|digit| digit * 10_u64.pow(decade)));
    let edges: Vec<u64> = std::iter::once(0).chain(edges.take(40)).collect();
    let bins = edges.windows(2).map(|edge| {
        let count = samples_ns.iter().filter(|&&sample| (edge[0]..edge[1]).contains(&sample)).count();
        Bin { from_ns: edge[0], to_ns: edge[1], count: count as u64 }
    });
    let mut bins: Vec<Bin> = bins.collect();
    let last = bins.iter().rposition(|bin| bin.count > 0).map_or(0, |last| last + 1);
    bins.truncate(last);
    let first = bins.iter().position(|bin| bin.count > 0).unwrap_or(0);
    bins.split_off(first)
}

/// A histogram as lines of text.
pub(crate) fn bars(bins: &[Bin]) -> String {
    const MAX_LENGTH: u64 = 50;
    let most = bins.iter().map(|bin| bin.count).max().unwrap_or(1).max(1);
    let line = |bin: &Bin| {
        let length = (bin.count * MAX_LENGTH).div_ceil(most) as usize;
        let range = format!("{} … {} µs", microseconds(bin.from_ns), microseconds(bin.to_ns));
        format!("  {range:>22}  {} {}\n", "█".repeat(length), bin.count)
    };
    bins.iter().map(line).collect()
}

/// What [`cells`] holds.
pub(crate) const HEADER: [&str; 6] = ["count", "p50", "p90", "p99", "p99.9", "max"];

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

    #[test]
    fn a_histogram_holds_every_sample_once() {
        let samples = [0, 1, 1, 2, 4, 5, 999, 1000, 40_000];
        let bins = histogram(&samples);
        let of = |from_ns, to_ns| {
            bins.iter().find(|bin| (bin.from_ns, bin.to_ns) == (from_ns, to_ns)).unwrap().count
        };
        assert_eq!(
            [of(0, 1), of(1, 2), of(2, 5), of(5, 10), of(500, 1000), of(1000, 2000)],
            [1, 2, 2, 1, 1, 1]
        );
        assert_eq!(bins.iter().map(|bin| bin.count).sum::<u64>(), 9);
        assert_eq!(bins.last().unwrap().to_ns, 50_000);
        assert_eq!(histogram(&[30]), [Bin { from_ns: 20, to_ns: 50, count: 1 }]);
        assert!(histogram(&[]).is_empty());
        assert_eq!(bars(&bins).lines().count(), bins.len());
    }
}
