//! The report of `bench step`: rows, their table, the JSON document, and findings in words.

use super::subject::Solver;
use crate::harness::machine::Machine;
use crate::harness::output::{table, three_digits};
use serde_json::{Map, Value, json};
use shared_types::outln;

/// Shares of all samples; a row gives the sample that each of them does not exceed.
pub(super) const QUANTILES: [f64; 13] =
    [0.0, 0.01, 0.05, 0.1, 0.25, 0.5, 0.75, 0.9, 0.95, 0.99, 0.999, 0.9999, 1.0];
const MEDIAN: usize = 5;
const P99: usize = 9;
const P999: usize = 10;
const MAX: usize = 12;

/// Another contestant's step, from the same run.
#[derive(Debug, Clone, Copy)]
pub(super) struct Rival {
    pub(super) median_ns: u64,
    pub(super) samples: usize,
}

/// One size.
#[derive(Debug, Clone)]
pub(super) struct Row {
    pub(super) solver: Solver,
    pub(super) n_centers: usize,
    /// How they are laid out.
    pub(super) centers: String,
    /// From the design to the channel.
    pub(super) set_up_s: f64,
    /// What a step reads.
    pub(super) bytes: usize,
    /// Of the local solver, relative to f̂.
    pub(super) predicted_error: Option<f64>,
    pub(super) samples: usize,
    /// Share of the time in which the thread had its core. Below 1, other processes affect the figures.
    pub(super) core_share: f64,
    pub(super) quantiles_ns: [u64; QUANTILES.len()],
    /// Share of the first steps that learned.
    pub(super) dead_zone_open: f64,
    /// The speed at which the memory was read, in turns with our steps.
    pub(super) memory_gb_per_s: f64,
    /// The reason why it was not run, if it was not; likewise for the others.
    pub(super) literal: Result<Rival, String>,
    /// Largest difference between our force and the literal one, relative to the force.
    pub(super) literal_force_difference: Option<f64>,
    pub(super) kalman: Rival,
    /// The gradient law's dense step, in turns: of [`YARDSTICK`] centers with a local one, of as many with a joint one.
    pub(super) yardstick: Option<Rival>,
}

/// Centers of the dense step with which the local solver is compared: those of the paper.
pub(super) const YARDSTICK: usize = 27;

impl Row {
    pub(super) fn median_ns(&self) -> f64 {
        self.quantiles_ns[MEDIAN] as f64
    }

    pub(super) fn p99_ns(&self) -> f64 {
        self.quantiles_ns[P99] as f64
    }

    /// The ratio of another contestant's time to ours.
    fn ratio(&self, rival: &Rival) -> f64 {
        rival.median_ns as f64 / self.median_ns()
    }

    /// The speed at which a step reads its factor and centers, over that of the memory. Above 1 where they lie in a cache.
    fn memory_share(&self) -> f64 {
        self.bytes as f64 / self.median_ns() / self.memory_gb_per_s
    }

    fn document(&self) -> Value {
        let mut document = Map::new();
        let mut put = |key: String, value: Value| document.insert(key, value);
        put("solver".into(), json!(self.solver.name()));
        if self.solver == Solver::Joint {
            put("dense_ratio".into(), json!(self.yardstick.map(|dense| self.ratio(&dense))));
        }
        if let Solver::Local(block) = self.solver {
            put("block".into(), json!(block));
            put("predicted_error".into(), json!(self.predicted_error));
            put(format!("dense_{YARDSTICK}_ratio"), json!(self.yardstick.map(|dense| self.ratio(&dense))));
        }
        for (key, value) in [
            ("n_centers", json!(self.n_centers)),
            ("centers", json!(self.centers)),
            ("set_up_s", json!(self.set_up_s)),
            ("bytes", json!(self.bytes)),
            ("samples", json!(self.samples)),
            ("core_share", json!(self.core_share)),
            ("median_ns", json!(self.quantiles_ns[MEDIAN])),
            ("p99_ns", json!(self.quantiles_ns[P99])),
            ("p999_ns", json!(self.quantiles_ns[P999])),
            ("max_ns", json!(self.quantiles_ns[MAX])),
            ("quantiles_ns", json!(self.quantiles_ns)),
            ("median_ns_per_center", json!(self.median_ns() / self.n_centers as f64)),
            ("memory_gb_per_s", json!(self.memory_gb_per_s)),
            ("memory_share", json!(self.memory_share())),
            ("dead_zone_open", json!(self.dead_zone_open)),
            ("literal_force_difference", json!(self.literal_force_difference)),
        ] {
            put(key.into(), value);
        }
        if let Err(reason) = &self.literal {
            put("literal_force_difference_reason".into(), json!(reason));
        }
        let kalman = Ok(self.kalman);
        for (name, rival) in [("literal", &self.literal), ("kalman", &kalman)] {
            put(format!("{name}_samples"), json!(rival.as_ref().map_or(0, |rival| rival.samples)));
            put(format!("{name}_median_ns"), json!(rival.as_ref().ok().map(|rival| rival.median_ns)));
            put(format!("{name}_ratio"), json!(rival.as_ref().ok().map(|rival| self.ratio(rival))));
            if let Err(reason) = rival {
                put(format!("{name}_median_ns_reason"), json!(reason));
                put(format!("{name}_ratio_reason"), json!(reason));
            }
        }
        document.into()
    }
}

/// The document of `bench step --json`.
pub(super) fn document(machine: &Machine, rows: &[Row]) -> Value {
    let documents: Vec<_> = rows.iter().map(Row::document).collect();
    json!({ "machine": machine, "quantiles": QUANTILES, "rows": documents })
}

pub(super) fn print(machine: &Machine, rows: &[Row]) {
    machine.print();
    let header = [
        "solver",
        "N",
        "kB",
        "samples",
        "median (µs)",
        "p99 (µs)",
        "p99.9 (µs)",
        "max (µs)",
        "ns/center",
        "of memory",
        "literal",
        "Kalman",
    ];
    let ratio = |rival: Result<&Rival, &String>, row: &Row| {
        rival.map_or("–".into(), |rival| times(row.ratio(rival)))
    };
    let row = |row: &Row| {
        let microseconds = |quantile: usize| three_digits(row.quantiles_ns[quantile] as f64 * 1e-3);
        [
            row.solver.to_string(),
            row.n_centers.to_string(),
            three_digits(row.bytes as f64 * 1e-3),
            row.samples.to_string(),
            microseconds(MEDIAN),
            microseconds(P99),
            microseconds(P999),
            microseconds(MAX),
            three_digits(row.median_ns() / row.n_centers as f64),
            three_digits(row.memory_share()),
            ratio(row.literal.as_ref(), row),
            ratio(Ok(&row.kalman), row),
        ]
    };
    outln!("{}", table(&header, 1, rows.iter().map(row)));
    outln!("kB: what a step reads of the factor and the centers.");
    outln!(
        "of memory: the speed of that over a plain loop through 256 MB, in turns with it; above 1 in a cache."
    );
    outln!("literal, Kalman: their median over ours, in turns; – was not run:");
    outln!("  literal  the paper's formula with nalgebra, 3N×3N matrices");
    outln!("  Kalman   adskalman's filter, 6 states and 3 outputs, whatever N is\n");
    findings(rows).iter().for_each(|finding| outln!("{finding}"));
}

/// Below this share of its core, the thread was disturbed.
const MIN_CORE_SHARE: f64 = 0.97;

/// The findings from the rows, one sentence each.
fn findings(rows: &[Row]) -> Vec<String> {
    let mut findings = Vec::new();
    findings.extend(dense_findings(rows));
    findings.extend(joint_findings(rows));
    findings.extend(local_findings(rows));
    if let Some(worst) = rows.iter().filter_map(|row| row.literal_force_difference).reduce(f64::max) {
        findings.push(format!("The literal force and ours differ by at most {worst:.1e} of the force."));
    }
    let open = rows.iter().map(|row| row.dead_zone_open).fold(1.0, f64::min);
    findings.push(format!("At least {:.0} % of our steps learned.", 100.0 * open));
    let share = rows.iter().map(|row| row.core_share).fold(1.0, f64::min);
    if share < MIN_CORE_SHARE {
        findings.push(format!(
            "The machine was busy: at one size other processes had the core for {:.0} % of the time. Compare only what \
             took turns; the maxima mean nothing.",
            100.0 * (1.0 - share)
        ));
    }
    findings
}

/// How the dense steps grow, and where they cost as much as the Kalman filter's.
fn dense_findings(rows: &[Row]) -> Vec<String> {
    let mut findings = Vec::new();
    let mut rows: Vec<_> = rows.iter().filter(|row| row.solver == Solver::Dense).collect();
    rows.sort_by_key(|row| row.n_centers);
    rows.dedup_by_key(|row| row.n_centers);
    let growth = |pair: &[&Row]| {
        let exponent = exponent(pair[0], pair[1], Row::median_ns);
        format!("{exponent:.2} ({} to {})", pair[0].n_centers, pair[1].n_centers)
    };
    let exponents: Vec<_> = rows.windows(2).map(growth).collect();
    if !exponents.is_empty() {
        findings.push(format!("A dense step grows as N to the {}.", exponents.join(", ")));
    }
    if let Some(largest) = rows.last() {
        findings.push(format!(
            "At N = {} it takes {} µs and reads at {:.0} % of the memory's {:.1} GB/s; set up in {:.1} s.",
            largest.n_centers,
            three_digits(1e-3 * largest.median_ns()),
            100.0 * largest.memory_share(),
            largest.memory_gb_per_s,
            largest.set_up_s
        ));
    }
    if let Some(n) = crossing(&rows) {
        findings.push(format!("A dense step costs as much as the Kalman filter's at about N = {n:.0}."));
    }
    findings
}

/// The ratio of each joint step to the gradient law's dense step that took turns with it.
fn joint_findings(rows: &[Row]) -> Vec<String> {
    let finding = |row: &Row| {
        let dense = row.yardstick.filter(|_| row.solver == Solver::Joint)?;
        Some(format!(
            "A joint step of {} centers takes {} µs, ×{} the gradient law's dense one.",
            row.n_centers,
            three_digits(1e-3 * row.median_ns()),
            three_digits(row.ratio(&dense).recip()),
        ))
    };
    rows.iter().filter_map(finding).collect()
}

/// How the local steps grow, and their ratio to the dense step that took turns with them.
fn local_findings(rows: &[Row]) -> Vec<String> {
    let of_block = |solver: Solver| {
        let mut rows: Vec<_> = rows.iter().filter(|row| row.solver == solver).collect();
        rows.sort_by_key(|row| row.n_centers);
        let (smallest, largest) = (rows.first()?, rows.last()?);
        let dense_ones = |row: &Row| Some(row.ratio(&row.yardstick?).recip());
        let (first, last) = (dense_ones(smallest)?, dense_ones(largest)?);
        Some(format!(
            "A {solver} step of {} centers takes ×{} the dense one of {YARDSTICK}, of {} centers ×{}: ×{}. Its error is about \
             {:.1e} of the force (RMS, random updates).",
            smallest.n_centers,
            three_digits(first),
            largest.n_centers,
            three_digits(last),
            three_digits(last / first),
            largest.predicted_error?,
        ))
    };
    Solver::ALL.into_iter().filter(|solver| matches!(solver, Solver::Local(_))).filter_map(of_block).collect()
}

/// p of N^p through two rows.
fn exponent(from: &Row, to: &Row, time_ns: impl Fn(&Row) -> f64) -> f64 {
    (time_ns(to) / time_ns(from)).ln() / (to.n_centers as f64 / from.n_centers as f64).ln()
}

/// The N at which our step takes as long as the Kalman filter's, on the power law between two rows.
fn crossing(rows: &[&Row]) -> Option<f64> {
    let pair = rows
        .windows(2)
        .find(|pair| pair[0].ratio(&pair[0].kalman) >= 1.0 && pair[1].ratio(&pair[1].kalman) < 1.0)?;
    let power = exponent(pair[0], pair[1], |row| row.ratio(&row.kalman));
    Some(pair[0].n_centers as f64 * pair[0].ratio(&pair[0].kalman).powf(-power.recip()))
}

/// A ratio, small ones as a fraction.
fn times(ratio: f64) -> String {
    match ratio {
        _ if ratio < 0.1 => format!("1/{:.0}", ratio.recip()),
        _ => format!("×{}", three_digits(ratio)),
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    /// A row whose step takes N² ns, beside a filter that takes 400 ns.
    pub(in super::super) fn row(n_centers: usize) -> Row {
        let median_ns = (n_centers * n_centers) as u64;
        Row {
            solver: Solver::Dense,
            n_centers,
            centers: "lattice".into(),
            set_up_s: 0.5,
            bytes: 4 * n_centers * n_centers,
            predicted_error: None,
            samples: 10,
            core_share: 0.5,
            quantiles_ns: QUANTILES.map(|q| median_ns + ((q - 0.5) * 10.0) as u64),
            dead_zone_open: 0.9,
            memory_gb_per_s: 8.0,
            literal: match n_centers {
                ..100 => Ok(Rival { median_ns: 30 * median_ns, samples: 10 }),
                _ => Err("too large".into()),
            },
            literal_force_difference: None,
            kalman: Rival { median_ns: 400, samples: 10 },
            yardstick: None,
        }
    }

    #[test]
    fn every_missing_figure_has_its_reason_beside_it() {
        for n_centers in [10, 100] {
            let document = row(n_centers).document();
            let document = document.as_object().unwrap();
            for key in document.iter().filter(|(_, value)| value.is_null()).map(|(key, _)| key) {
                // The difference was not part of this made-up run.
                let reason = document.get(&format!("{key}_reason"));
                assert!(reason.is_some_and(Value::is_string) || key == "literal_force_difference", "{key}");
            }
            assert_eq!(document["literal_ratio"].is_number(), n_centers < 100);
            assert_eq!(document["solver"], "dense");
            assert_eq!(document["median_ns"], document["quantiles_ns"][MEDIAN]);
        }
    }

    #[test]
    fn the_findings_are_those_of_a_square_law() {
        let found = findings(&[row(10), row(100)]).join("\n");
        for expected in [
            "A dense step grows as N to the 2.00 (10 to 100).",
            "At N = 100 it takes 10.0 µs and reads at 50 % of the memory's 8.0 GB/s; set up in 0.5 s.",
            "costs as much as the Kalman filter's at about N = 20.",
            "At least 90 % of our steps learned.",
            "other processes had the core for 50 % of the time",
        ] {
            assert!(found.contains(expected), "{expected}\nnot in\n{found}");
        }
    }

    #[test]
    fn joint_steps_are_held_against_the_gradient_laws_in_turns() {
        let joint =
            Row { solver: Solver::Joint, yardstick: Some(Rival { median_ns: 50, samples: 10 }), ..row(10) };
        let found = findings(std::slice::from_ref(&joint)).join("\n");
        let expected = "A joint step of 10 centers takes 0.100 µs, ×2.00 the gradient law's dense one.";
        assert!(found.contains(expected), "{found}");
        let document = joint.document();
        assert_eq!((&document["solver"], &document["dense_ratio"]), (&json!("joint"), &json!(0.5)));
    }

    #[test]
    fn local_steps_are_held_against_the_dense_one_that_took_turns() {
        let local = |n_centers, median_ns, dense_ns| Row {
            solver: Solver::Local(4),
            quantiles_ns: [median_ns; QUANTILES.len()],
            predicted_error: Some(2e-3),
            yardstick: Some(Rival { median_ns: dense_ns, samples: 10 }),
            ..row(n_centers)
        };
        let found = findings(&[local(512, 2000, 200), local(1_000_000, 3300, 300)]).join("\n");
        let expected = "A local 4³ step of 512 centers takes ×10.0 the dense one of 27, of 1000000 centers ×11.0: ×1.10. \
                        Its error is about 2.0e-3 of the force";
        assert!(found.contains(expected), "{found}");
        let document = local(512, 2000, 200).document();
        assert_eq!((&document["solver"], &document["block"]), (&json!("local"), &json!(4)));
        assert_eq!(document["dense_27_ratio"], 0.1);
    }
}
