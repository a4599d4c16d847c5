//! Latencies: quantiles, histograms, and how tables show them.

use comfy_table::{CellAlignment, Table, presets};
use serde::Serialize;
use shared_types::LatencySummary;

/// Nearest-rank quantiles: the smallest sample that a share q of all samples does not exceed. `None` without
/// samples. Sorts them.
pub(crate) fn summary(samples_ns: &mut [u64]) -> Option<LatencySummary> {
    samples_ns.sort_unstable();
    let quantile = |q: f64| {
        let rank = (q * samples_ns.len() as f64).ceil() as usize;
        samples_ns[rank.clamp(1, samples_ns.len()) - 1]
    };
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
    const LONGEST: u64 = 50;
    let most = bins.iter().map(|bin| bin.count).max().unwrap_or(1).max(1);
    let line = |bin: &Bin| {
        let length = (bin.count * LONGEST).div_ceil(most) as usize;
        let range = format!("{} … {} µs", microseconds(bin.from_ns), microseconds(bin.to_ns));
        format!("  {range:>22}  {} {}\n", "█".repeat(length), bin.count)
    };
    bins.iter().map(line).collect()
}

/// Three digits of a time in microseconds.
pub(crate) fn microseconds(ns: u64) -> String {
    three_digits(ns as f64 * 1e-3)
}

/// Three digits, without an exponent.
pub(crate) fn three_digits(value: f64) -> String {
    match value {
        _ if value < 0.9995 => format!("{value:.3}"),
        _ if value < 9.995 => format!("{value:.2}"),
        _ if value < 99.95 => format!("{value:.1}"),
        _ => format!("{value:.0}"),
    }
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

/// A table whose first columns name a row, and whose others hold numbers.
pub(crate) fn table(header: &[&str], n_names: usize, rows: impl IntoIterator<Item = Vec<String>>) -> Table {
    let mut table = Table::new();
    table.load_style(presets::UTF8_FULL_CONDENSED).set_header(header.iter().copied());
    for row in rows {
        table.add_row(row);
    }
    for column in table.column_iter_mut().skip(n_names) {
        column.set_cell_alignment(CellAlignment::Right);
    }
    table
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
        assert_eq!(summary(&mut [7]).unwrap().p999, 7);
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
