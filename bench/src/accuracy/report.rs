//! The table and the JSON document of `bench accuracy`.

use super::HORIZONS_S;
use super::cases::Case;
use super::judge::Judgement;
use crate::harness::output::table;
use serde_json::{Map, Value, json};
use shared_types::outln;
use std::path::Path;

/// The judgements of one flight.
#[derive(Debug, Clone, Default)]
pub(super) struct Estimators {
    pub(super) joint: Judgement,
    pub(super) gradient: Judgement,
    pub(super) none: Judgement,
    pub(super) least_squares: Judgement,
    /// With each density of its force.
    pub(super) kalman: Vec<Judgement>,
    pub(super) gauss_markov: Vec<Judgement>,
}

/// Column 0 is the next sample's error, the others are those after coasts.
const N_COLUMNS: usize = 1 + HORIZONS_S.len();

fn error(judgement: &Judgement, column: usize) -> Option<f64> {
    let mean = match column {
        0 => judgement.one_step,
        _ => judgement.coasts[column - 1],
    };
    mean.root().filter(|error| error.is_finite())
}

/// The estimator of a sweep with the least error in one column.
pub(super) fn best(sweep: &[Judgement], column: usize) -> &Judgement {
    let cost = |judgement: &&Judgement| error(judgement, column).unwrap_or(f64::INFINITY);
    sweep.iter().min_by(|a, b| cost(a).total_cmp(&cost(b))).expect("a sweep has densities")
}

/// One estimator on one flight, as it is shown.
struct Row {
    file: String,
    estimator: &'static str,
    samples: usize,
    errors: [Option<f64>; N_COLUMNS],
    coasts: [usize; HORIZONS_S.len()],
    nis: Option<f64>,
    coverage_95: [Option<f64>; HORIZONS_S.len()],
}

impl Row {
    fn of(case: &Case, estimator: &'static str, judgement: &Judgement) -> Self {
        Self {
            file: case.name.clone(),
            estimator,
            samples: judgement.one_step.count,
            errors: std::array::from_fn(|column| error(judgement, column)),
            coasts: judgement.coasts.map(|coast| coast.count),
            nis: judgement.nis(),
            coverage_95: std::array::from_fn(|horizon| judgement.coverage_95(horizon)),
        }
    }

    /// Of a sweep the best in each column, without a coverage, since no single one has it.
    fn best_of(case: &Case, estimator: &'static str, sweep: &[Judgement]) -> Self {
        let first = Self::of(case, estimator, &sweep[0]);
        Self {
            errors: std::array::from_fn(|column| error(best(sweep, column), column)),
            nis: None,
            coverage_95: [None; HORIZONS_S.len()],
            ..first
        }
    }

    fn json(&self) -> Value {
        let key = |horizon: usize| HORIZONS_S[horizon].to_string();
        let by_horizon = |value: &dyn Fn(usize) -> Value| -> Map<String, Value> {
            (0..HORIZONS_S.len()).map(|horizon| (key(horizon), value(horizon))).collect()
        };
        let mut document = json!({
            "file": self.file,
            "estimator": self.estimator,
            "samples": self.samples,
            "one_step_rms_m_s": self.errors[0],
            "coast_rms_m_s": by_horizon(&|horizon| self.errors[horizon + 1].into()),
            "coasts": by_horizon(&|horizon| self.coasts[horizon].into()),
            "nis": self.nis,
            "coverage_95": by_horizon(&|horizon| self.coverage_95[horizon].into()),
        });
        let mut reason = |key: &str, reason: &str| document[format!("{key}_reason")] = reason.into();
        if self.errors[1..].iter().any(Option::is_none) {
            reason(
                "coast_rms_m_s",
                "the flight has no coast of this length without a gap, or the estimator diverged",
            );
        }
        if self.errors[0].is_none() {
            reason("one_step_rms_m_s", "no sample follows another without a gap, or the estimator diverged");
        }
        if self.nis.is_none() {
            reason("nis", "the estimator says no deviations of its output, or is a best of several");
            reason("coverage_95", "the estimator says no deviations, or is a best of several");
        }
        document
    }
}

/// All rows, flight by flight, and the means over the flights.
pub(super) struct Report {
    rows: Vec<Row>,
    refused: Vec<(String, String)>,
    /// What importers say of flights.
    remarks: Vec<(String, String)>,
    /// Geometric means of the ratios to the best Kalman filter, by estimator.
    means: Vec<(&'static str, [Option<f64>; N_COLUMNS])>,
}

impl Report {
    pub(super) fn new(cases: &[Case], judged: &[Estimators], refused: Vec<(String, String)>) -> Self {
        let one = one_density(judged);
        let mut rows = Vec::new();
        for (case, estimators) in cases.iter().zip(judged) {
            rows.extend([
                Row::of(case, "joint", &estimators.joint),
                Row::of(case, "gradient", &estimators.gradient),
                Row::of(case, "none", &estimators.none),
                Row::best_of(case, "kalman", &estimators.kalman),
                Row::of(case, "kalman-one-q", &estimators.kalman[one]),
                Row::best_of(case, "gauss-markov", &estimators.gauss_markov),
                Row::of(case, "least-squares", &estimators.least_squares),
            ]);
        }
        let kalman: Vec<[Option<f64>; N_COLUMNS]> =
            rows.iter().filter(|row| row.estimator == "kalman").map(|row| row.errors).collect();
        let names = ["joint", "gradient", "none", "kalman-one-q", "gauss-markov", "least-squares"];
        let means = names.map(|name| {
            let own = || rows.iter().filter(|row| row.estimator == name).map(|row| row.errors);
            let mean = |column: usize| {
                let ratios =
                    own().zip(&kalman).filter_map(|(own, kalman)| Some(own[column]? / kalman[column]?));
                let logarithms: Vec<f64> = ratios.map(f64::ln).collect();
                let mean = logarithms.iter().sum::<f64>() / logarithms.len() as f64;
                (!logarithms.is_empty()).then(|| mean.exp())
            };
            (name, std::array::from_fn(mean))
        });
        let remarks_of = |case: &Case| {
            let name = case.name.clone();
            case.remarks.clone().into_iter().map(move |remark| (name.clone(), remark))
        };
        Self { rows, refused, remarks: cases.iter().flat_map(remarks_of).collect(), means: means.to_vec() }
    }

    pub(super) fn json(&self) -> Value {
        let means = self.means.iter().map(|(name, ratios)| {
            let coasts = HORIZONS_S.iter().zip(&ratios[1..]);
            let coasts: Map<String, Value> =
                coasts.map(|(horizon, ratio)| (horizon.to_string(), (*ratio).into())).collect();
            json!({ "estimator": name, "one_step": ratios[0], "coast": coasts })
        });
        json!({
            "rows": self.rows.iter().map(Row::json).collect::<Vec<_>>(),
            "geometric_mean_over_kalman": means.collect::<Vec<_>>(),
            "remarks": self.remarks.iter().map(|(file, remark)| json!({ "file": file, "remark": remark }))
                .collect::<Vec<_>>(),
            "not_judged": self.refused.iter().map(|(file, reason)| json!({ "file": file, "reason": reason }))
                .collect::<Vec<_>>(),
        })
    }

    /// The cells of the rows of one flight: its name, then estimators, errors with their ratios to the Kalman filter's, NIS,
    /// coverage.
    pub(super) fn cells(&self) -> Vec<Vec<String>> {
        let cells = self.rows.iter().enumerate().map(|(index, row)| {
            let block = &self.rows[index / 7 * 7..];
            let kalman = block.iter().find(|row| row.estimator == "kalman").map(|row| row.errors);
            let number = |column: usize| match (row.errors[column], kalman.and_then(|kalman| kalman[column]))
            {
                (Some(error), Some(kalman)) if row.estimator != "kalman" => {
                    format!("{error:.4} ({:.2})", error / kalman)
                }
                (Some(error), _) => format!("{error:.4}"),
                (None, _) => "-".into(),
            };
            let coverage = row.coverage_95.iter().flatten().map(|part| format!("{:.0}", 100.0 * part));
            let coverage: Vec<String> = coverage.collect();
            let name = if index % 7 == 0 { short(&row.file) } else { String::new() };
            [name, row.estimator.into()]
                .into_iter()
                .chain((0..N_COLUMNS).map(number))
                .chain([row.nis.map_or("-".into(), |nis| format!("{nis:.2}"))])
                .chain([if coverage.is_empty() { "-".into() } else { coverage.join(" ") }])
                .collect()
        });
        let means = self.means.iter().enumerate().map(|(index, (name, ratios))| {
            let name_of_block = if index == 0 { "geometric mean".into() } else { String::new() };
            let ratios = ratios.iter().map(|ratio| ratio.map_or("-".into(), |ratio| format!("({ratio:.2})")));
            [name_of_block, (*name).to_owned()]
                .into_iter()
                .chain(ratios)
                .chain(["".into(), "".into()])
                .collect()
        });
        cells.chain(means).collect()
    }

    pub(super) fn header() -> Vec<String> {
        let coasts = HORIZONS_S.iter().map(|seconds| format!("{seconds} s"));
        ["flight", "estimator", "next sample"]
            .map(str::to_owned)
            .into_iter()
            .chain(coasts)
            .chain(["NIS".into(), "95 % covers".into()])
            .collect()
    }

    /// What importers say of flights, and of the files that are not judged a sentence each.
    pub(super) fn remarks(&self) -> impl Iterator<Item = String> {
        let remarks = self.remarks.iter().map(|(file, remark)| format!("{}: {remark}", short(file)));
        remarks.chain(self.refused.iter().map(|(file, reason)| format!("{file} is not judged: {reason}")))
    }

    pub(super) fn print(&self, page: Option<&Path>) {
        let header = Self::header();
        let header: Vec<&str> = header.iter().map(String::as_str).collect();
        outln!(
            "RMS of the velocity error's norm (m/s) over the second half in the air, in brackets over the Kalman filter's;\n\
             after coasts of these lengths; the part of the errors within the 95 % band after each (%)"
        );
        outln!("{}", table(&header, 2, self.cells()));
        outln!(
            "kalman, gauss-markov: the best of 17 densities in each column; kalman-one-q: one for all flights.\n\
             The band has no part for the sensor's own noise, which the error after a coast on a recorded flight contains."
        );
        self.remarks().for_each(|remark| outln!("{remark}"));
        if let Some(page) = page {
            outln!("{}", page.display());
        }
    }
}

/// The density with the least geometric mean of the shortest coast over all flights.
fn one_density(judged: &[Estimators]) -> usize {
    let cost = |index: usize| -> f64 {
        judged.iter().filter_map(|estimators| error(&estimators.kalman[index], 1)).map(f64::ln).sum()
    };
    (0..judged[0].kalman.len()).min_by(|a, b| cost(*a).total_cmp(&cost(*b))).unwrap_or(0)
}

/// The last part of a path.
pub(super) fn short(file: &str) -> String {
    Path::new(file).file_name().map_or(file.into(), |name| name.to_string_lossy().into_owned())
}
