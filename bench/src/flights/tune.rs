//! `bench tune`: searches a configuration of the translation on the first half of a recorded flight.
//!
//! The second half is never looked at before the end. Of the first half, the time after the first 2 s is cut into
//! blocks, and what is minimised is the mean over the blocks of
//!
//! `J = w ln(c / c₀) + (1 − w) ln(s / s₀)`
//!
//! with c the geometric mean of the errors after a coast, s that of the next sample's prediction, and ₀ those of the
//! configuration to start from: ratios, so that one wild manoeuvre counts no more than a calm second. The search
//! (Nelder–Mead, from several simplices) runs in the logarithms of λ, Γ, ℓ, the dead zone and the centers' spacing over
//! ℓ; what the observer refuses as unstable costs more than anything else, so that nothing outside of the provably
//! stable set is ever chosen.
//!
//! Of all that was tried, what is chosen is least in `J + μ ‖q‖²`, with q the logarithms of the factors on the start's
//! numbers: a better fit must pay for its distance from where a person began. μ is cross-validated over time: for each
//! block, the candidate that is chosen on the others is judged on it, and the highest μ within a standard error of the
//! best one is taken (Breiman et al., *Classification and Regression Trees*, 1984, §3.4.3).

use super::accuracy::{Finding, Flight, ObserverEstimator, best, evaluate, evaluate_kalman, fly};
use super::arguments::{FlightArguments, Replay};
use crate::harness::output::{progress_bar, show, table};
use anyhow::{Context, ensure};
use argmin::core::{CostFunction, Executor};
use argmin::solver::neldermead::NelderMead;
use clap::Args;
use daemon::assemble;
use daemon::config::{ConfigFile, LengthScaleConfig, SymmetricMatrix, TranslationConfig};
use indicatif::ProgressBar;
use nalgebra::Vector3;
use observer::Learn;
use serde::Serialize;
use shared_types::outln;
use std::path::PathBuf;
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};

/// Blocks of the cross-validation.
const N_BLOCKS: usize = 3;
/// The exact solver is used up to this number of centers; no more are tried.
const MAX_CENTERS: usize = 1000;
/// What a candidate costs that is refused, or lies outside of the bounds; no real one comes near.
const REFUSED: f64 = 1e3;
/// Prices μ of the distance from the start; the last one is hardly ever worth a step.
const PRICES: [f64; 9] = [0.0, 0.001, 0.003, 0.01, 0.03, 0.1, 0.3, 1.0, 3.0];
/// Factors on λ, Γ, ℓ, the dead zone and the spacing from which the searches start.
const STARTS: [[f64; 5]; 4] =
    [[1.0; 5], [1.0, 0.1, 1.0, 1.0, 1.0], [2.0, 1.0, 2.0, 0.5, 1.0], [0.5, 0.2, 0.5, 1.0, 1.0]];
/// Errors below this count as this (m/s).
const MIN_ERROR_M_S: f64 = 1e-6;
/// A search that panics ends the program.
const UNPOISONED: &str = "no search panicked";
/// Edge of the first simplex, as a factor.
const EDGE: f64 = 1.6;

/// Arguments of `bench tune`.
#[derive(Debug, Args)]
pub(crate) struct TuneArguments {
    #[command(flatten)]
    flight: FlightArguments,
    /// Search the nominal mass too, within a quarter of its value: for a vehicle that was not weighed as it flies.
    #[arg(long)]
    mass: bool,
    /// How much the coasts count beside the next sample's prediction, 0 … 1.
    #[arg(long, value_name = "W", default_value_t = 0.8)]
    coast_weight: f64,
    /// Configurations that are tried, about.
    #[arg(long, value_name = "N", default_value_t = 600)]
    evaluations: u64,
    /// Where the configuration is written; not at all where it is no better.
    #[arg(long, value_name = "FILE", default_value = "tuned.toml")]
    out: PathBuf,
    /// Print one JSON document.
    #[arg(long)]
    json: bool,
}

/// Errors of one configuration on one part of the flight (m/s).
#[derive(Debug, Clone, Copy, Serialize)]
struct Errors {
    one_step_rms_m_s: f64,
    coast_rms_m_s: f64,
}

/// What `--json` prints.
#[derive(Debug, Serialize)]
struct Document {
    file: String,
    start: String,
    improved: bool,
    written: Option<String>,
    evaluations: usize,
    refused_as_unstable_or_out_of_bounds: usize,
    coast_s: f64,
    /// Of the first half, on which it was tuned: before, after.
    tuned_on: [Errors; 2],
    /// μ.
    price: f64,
    /// exp J of each block, by the candidate that is chosen on the other blocks; 1 is the start.
    cross_validated_ratio: f64,
    /// Of the second half, which the search never saw: before, after.
    second_half: [Errors; 2],
    /// The best of each of a Kalman filter's columns there.
    kalman_second_half: Errors,
    values: Values,
}

/// What was found.
#[derive(Debug, Clone, Copy, Serialize)]
struct Values {
    mass_kg: f64,
    gain_per_s: f64,
    adaptation_rate_kg_s2: f64,
    length_scale_m_s: f64,
    dead_zone_width_m_s: f64,
    centers_lower_m_s: [f64; 3],
    centers_upper_m_s: [f64; 3],
    centers_per_axis: [usize; 3],
}

/// A candidate that was tried: its coordinates and its block costs' parts, ln of coast and step error.
struct Tried {
    coordinates: Vec<f64>,
    blocks: Vec<[f64; 2]>,
}

/// The search's side: coordinates to configurations to costs.
struct Search<'a> {
    start: &'a ConfigFile,
    base: Values,
    /// Distance of the start's centers over its length scale.
    start_spacing: f64,
    flight: &'a Flight,
    coast_weight: f64,
    with_mass: bool,
    reference: Vec<[f64; 2]>,
    tried: Mutex<Vec<Tried>>,
    refused: AtomicUsize,
    bar: &'a ProgressBar,
}

/// Runs `bench tune`.
///
/// # Errors
/// The flight or the configuration cannot be used, or the result not be written.
pub(crate) fn run(arguments: &TuneArguments) -> anyhow::Result<()> {
    let weight = arguments.coast_weight;
    ensure!((0.0..=1.0).contains(&weight), "--coast-weight {weight}: needed: 0 … 1");
    let Replay { config: start, flight, .. } = arguments.flight.read()?;
    let translation = start.config.translation.as_ref().context("the configuration has no [translation]")?;
    assemble::rigid_body(&start)?;
    let first_half = flight.first_half()?;
    let base = values_of(translation, &first_half)?;

    let bar =
        progress_bar(arguments.evaluations, "{bar:40} {pos}/{len} configurations, {eta} left; best {msg}");
    let mut search = Search {
        start: &start,
        base,
        start_spacing: spacing_of(&base),
        flight: &first_half,
        coast_weight: weight,
        with_mass: arguments.mass,
        reference: Vec::new(),
        tried: Mutex::default(),
        refused: AtomicUsize::default(),
        bar: &bar,
    };
    search.reference = block_errors(&first_half, &start)?;
    search.descend(arguments.evaluations)?;
    bar.finish_and_clear();

    let tried = std::mem::take(search.tried.get_mut().expect(UNPOISONED));
    let n_refused = *search.refused.get_mut();
    let (price, cross_validated_cost) = search.price(&tried);
    let chosen = search.best_of(&tried, None, price).context("every configuration was refused")?;
    let coordinates = &chosen.coordinates;
    let values = search.values(coordinates).context("the best one is within the bounds")?;
    let tuned = search.config(&values);
    let errors = |config: &ConfigFile, flight: &Flight| -> anyhow::Result<Errors> {
        let accuracy = evaluate(flight, ObserverEstimator(assemble::rigid_body(&config)?, Learn::ALL))?;
        let (one_step_rms_m_s, coast_rms_m_s) = (accuracy.one_step_rms_m_s, accuracy.coast_rms_m_s);
        Ok(Errors { one_step_rms_m_s, coast_rms_m_s })
    };
    let second_half = [errors(&start, &flight)?, errors(&tuned, &flight)?];
    let kalman = evaluate_kalman(&flight, translation)?;
    let improved = second_half[1].coast_rms_m_s < second_half[0].coast_rms_m_s;
    let mut document = Document {
        file: arguments.flight.file().display().to_string(),
        start: start.name().to_owned(),
        improved,
        written: None,
        evaluations: tried.len() + n_refused,
        refused_as_unstable_or_out_of_bounds: n_refused,
        coast_s: flight.coast_s,
        tuned_on: [errors(&start, &first_half)?, errors(&tuned, &first_half)?],
        price,
        cross_validated_ratio: cross_validated_cost.exp(),
        second_half,
        kalman_second_half: Errors {
            one_step_rms_m_s: best(&kalman, |accuracy| accuracy.one_step_rms_m_s).1.one_step_rms_m_s,
            coast_rms_m_s: best(&kalman, |accuracy| accuracy.coast_rms_m_s).1.coast_rms_m_s,
        },
        values,
    };
    if improved {
        let text = head(&document) + &tuned.commented_toml();
        let file = arguments.out.display().to_string();
        std::fs::write(&arguments.out, text).with_context(|| format!("cannot write '{file}'"))?;
        document.written = Some(file);
    }
    show(arguments.json, &document, || print(&document))
}

/// The start's own numbers; the box of its centers widened to the velocities flown, with a tenth of their range to spare.
fn values_of(translation: &TranslationConfig, flight: &Flight) -> anyhow::Result<Values> {
    let lattice =
        (translation.centers_lower_m_s, translation.centers_upper_m_s, translation.centers_per_axis);
    let (Some(lower), Some(upper), Some(per_axis)) = lattice else {
        anyhow::bail!("the configuration lists its centers; needed: a lattice (centers_lower_m_s and so on)");
    };
    let (lowest, highest) = (flight.extreme_velocity(f64::min), flight.extreme_velocity(f64::max));
    let room: [f64; 3] = std::array::from_fn(|axis| 0.1 * (highest[axis] - lowest[axis]));
    let length_scale_m_s = match &translation.length_scale_m_s {
        LengthScaleConfig::Isotropic(scale) => *scale,
        LengthScaleConfig::PerAxis(scales) => scales.iter().sum::<f64>() / scales.len() as f64,
    };
    let adaptation_rate_kg_s2 = match translation.adaptation_rate_kg_s2 {
        SymmetricMatrix::Scalar(rate) => rate,
        SymmetricMatrix::Diagonal(rates) => rates.iter().sum::<f64>() / 3.0,
        SymmetricMatrix::Full(rows) => (rows[0][0] + rows[1][1] + rows[2][2]) / 3.0,
    };
    Ok(Values {
        mass_kg: translation.mass_kg,
        gain_per_s: translation.gain_per_s,
        adaptation_rate_kg_s2,
        length_scale_m_s,
        dead_zone_width_m_s: translation.dead_zone_width_m_s,
        centers_lower_m_s: std::array::from_fn(|axis| lower[axis].min(lowest[axis] - room[axis])),
        centers_upper_m_s: std::array::from_fn(|axis| upper[axis].max(highest[axis] + room[axis])),
        centers_per_axis: per_axis,
    })
}

fn spacing_of(values: &Values) -> f64 {
    let edge_m_s = values.centers_upper_m_s[0] - values.centers_lower_m_s[0];
    let n_gaps = values.centers_per_axis[0].saturating_sub(1).max(1) as f64;
    (edge_m_s / n_gaps / values.length_scale_m_s).clamp(0.25, 1.8)
}

impl Search<'_> {
    /// Coordinates: logarithms of the factors on λ, Γ, ℓ and d, of the spacing over ℓ, and of the factor on m.
    fn values(&self, coordinates: &[f64]) -> Option<Values> {
        let factor = |index: usize| coordinates[index].exp();
        let base = &self.base;
        let mass_factor = if self.with_mass { factor(5) } else { 1.0 };
        let length_scale_m_s = base.length_scale_m_s * factor(2);
        let spacing_m_s = length_scale_m_s * factor(4);
        let centers_per_axis: [usize; 3] = std::array::from_fn(|axis| {
            let edge_m_s = base.centers_upper_m_s[axis] - base.centers_lower_m_s[axis];
            // A float becomes the nearest usize, whatever it is.
            ((edge_m_s / spacing_m_s).round() as usize).saturating_add(1).max(2)
        });
        let n_centers = centers_per_axis.iter().fold(1_usize, |n, &each| n.saturating_mul(each));
        let within = coordinates.iter().all(|c| c.abs() < 50_f64.ln())
            && (0.75..=1.25).contains(&mass_factor)
            && (0.2..=2.0).contains(&factor(4))
            && n_centers <= MAX_CENTERS;
        within.then(|| Values {
            mass_kg: base.mass_kg * mass_factor,
            gain_per_s: base.gain_per_s * factor(0),
            adaptation_rate_kg_s2: base.adaptation_rate_kg_s2 * factor(1),
            length_scale_m_s,
            dead_zone_width_m_s: base.dead_zone_width_m_s * factor(3),
            centers_per_axis,
            ..*base
        })
    }

    fn config(&self, values: &Values) -> ConfigFile {
        let mut file = self.start.clone();
        let translation = file.config.translation.as_mut().expect("the start has one");
        let buffer_ratio = translation.dead_zone_buffer_m_s / translation.dead_zone_width_m_s;
        translation.mass_kg = values.mass_kg;
        translation.gain_per_s = values.gain_per_s;
        // Axes keep their proportions.
        let factor = values.adaptation_rate_kg_s2 / self.base.adaptation_rate_kg_s2;
        match &mut translation.adaptation_rate_kg_s2 {
            SymmetricMatrix::Scalar(rate) => *rate *= factor,
            SymmetricMatrix::Diagonal(rates) => rates.iter_mut().for_each(|rate| *rate *= factor),
            SymmetricMatrix::Full(rows) => rows.iter_mut().flatten().for_each(|rate| *rate *= factor),
        }
        let factor = values.length_scale_m_s / self.base.length_scale_m_s;
        match &mut translation.length_scale_m_s {
            LengthScaleConfig::Isotropic(scale) => *scale *= factor,
            LengthScaleConfig::PerAxis(scales) => scales.iter_mut().for_each(|scale| *scale *= factor),
        }
        translation.dead_zone_width_m_s = values.dead_zone_width_m_s;
        translation.dead_zone_buffer_m_s = values.dead_zone_width_m_s * buffer_ratio;
        translation.centers_lower_m_s = Some(values.centers_lower_m_s);
        translation.centers_upper_m_s = Some(values.centers_upper_m_s);
        translation.centers_per_axis = Some(values.centers_per_axis);
        file
    }

    /// Nelder–Mead from each start, all at once, then once more from the best of all.
    fn descend(&self, n_evaluations: u64) -> anyhow::Result<()> {
        let each = n_evaluations / (STARTS.len() as u64 + 1);
        let corner = |factors: [f64; 5]| {
            let mut corner: Vec<f64> = factors.iter().map(|factor| factor.ln()).collect();
            corner[4] += self.start_spacing.ln();
            corner.extend(self.with_mass.then_some(0.0));
            corner
        };
        std::thread::scope(|scope| {
            let searches =
                STARTS.map(|factors| scope.spawn(move || self.descend_from(corner(factors), each)));
            searches.into_iter().try_for_each(|search| search.join().expect("a search does not panic"))
        })?;
        let best = self
            .best_of(&self.tried.lock().expect(UNPOISONED), None, 0.0)
            .map(|tried| tried.coordinates.clone());
        best.map_or(Ok(()), |best| self.descend_from(best, each))
    }

    fn descend_from(&self, corner: Vec<f64>, n_evaluations: u64) -> anyhow::Result<()> {
        let mut simplex = vec![corner.clone()];
        for axis in 0..corner.len() {
            let edge = if axis == 5 { 1.05_f64.ln() } else { EDGE.ln() };
            let mut point = corner.clone();
            point[axis] += if axis % 2 == 0 { edge } else { -edge };
            simplex.push(point);
        }
        // An iteration of Nelder–Mead costs one or two evaluations, a shrinking more.
        let solver = NelderMead::new(simplex).with_sd_tolerance(1e-4)?;
        let result = Executor::new(Shared(self), solver)
            .configure(|state| state.max_iters(n_evaluations * 2 / 3))
            .run()?;
        ensure!(result.state().get_best_cost().is_finite(), "the search found no finite cost");
        Ok(())
    }

    /// Mean over the blocks, or over all but one.
    fn cost_of(&self, blocks: &[[f64; 2]], without: Option<usize>) -> f64 {
        let kept = (0..blocks.len()).filter(|block| Some(*block) != without);
        let costs: Vec<f64> = kept.map(|block| self.block_cost(blocks, block)).collect();
        costs.iter().sum::<f64>() / costs.len() as f64
    }

    /// J of one block.
    fn block_cost(&self, blocks: &[[f64; 2]], block: usize) -> f64 {
        let ([coast, step], [coast_0, step_0]) = (blocks[block], self.reference[block]);
        self.coast_weight * (coast / coast_0).ln() + (1.0 - self.coast_weight) * (step / step_0).ln()
    }

    fn best_of<'t>(&self, tried: &'t [Tried], without: Option<usize>, price: f64) -> Option<&'t Tried> {
        let cost =
            |tried: &Tried| self.cost_of(&tried.blocks, without) + price * self.distance(&tried.coordinates);
        tried.iter().min_by(|a, b| cost(a).total_cmp(&cost(b)))
    }

    /// Squared distance from the start, in logarithms.
    fn distance(&self, coordinates: &[f64]) -> f64 {
        let square =
            |(index, c): (usize, &f64)| if index == 4 { c - self.start_spacing.ln() } else { *c }.powi(2);
        coordinates.iter().enumerate().map(square).sum()
    }

    /// The highest price whose cost, on blocks that did not choose, is within a standard error of the least one's
    /// (of what cannot be told apart, that which is nearest to the start); and that cost.
    fn price(&self, tried: &[Tried]) -> (f64, f64) {
        let n_blocks = self.reference.len();
        let judged = PRICES.map(|price| {
            let costs: Vec<f64> = (0..n_blocks)
                .filter_map(|block| {
                    let chosen = self.best_of(tried, Some(block), price)?;
                    Some(self.block_cost(&chosen.blocks, block))
                })
                .collect();
            let mean = costs.iter().sum::<f64>() / costs.len() as f64;
            let variance =
                costs.iter().map(|cost| (cost - mean).powi(2)).sum::<f64>() / (n_blocks - 1) as f64;
            (price, mean, (variance / n_blocks as f64).sqrt())
        });
        let (_, least, error) =
            judged.into_iter().min_by(|(_, a, _), (_, b, _)| a.total_cmp(b)).expect("there are prices");
        let (price, mean, _) = judged
            .into_iter()
            .rfind(|(_, mean, _)| *mean <= least + error)
            .expect("the least one is among them");
        (price, mean)
    }
}

/// What argmin takes by value.
struct Shared<'a, 'b>(&'a Search<'b>);

impl CostFunction for Shared<'_, '_> {
    type Param = Vec<f64>;
    type Output = f64;

    fn cost(&self, coordinates: &Vec<f64>) -> Result<f64, argmin::core::Error> {
        let search = self.0;
        search.bar.inc(1);
        let far = coordinates.iter().map(|c| c.abs()).sum::<f64>();
        let config = search.values(coordinates).map(|values| search.config(&values));
        let blocks = config.and_then(|config| block_errors(search.flight, &config).ok());
        let Some(blocks) = blocks.filter(|blocks| blocks.iter().flatten().all(|e| e.is_finite())) else {
            search.refused.fetch_add(1, Ordering::Relaxed);
            return Ok(REFUSED + far);
        };
        let cost = search.cost_of(&blocks, None);
        let mut tried = search.tried.lock().expect(UNPOISONED);
        tried.push(Tried { coordinates: coordinates.clone(), blocks });
        let best = search.best_of(&tried, None, 0.0).map_or(cost, |best| search.cost_of(&best.blocks, None));
        search.bar.set_message(format!("{:.1} % off the start's errors", 100.0 * (1.0 - best.exp())));
        Ok(cost)
    }
}

/// Typical errors of coast and next sample in each block (m/s).
fn block_errors(flight: &Flight, config: &ConfigFile) -> anyhow::Result<Vec<[f64; 2]>> {
    let mut sums: Vec<[MeanLog; 2]> = (0..N_BLOCKS).map(|_| Default::default()).collect();
    let learned_in = flight.half;
    let length = (flight.samples.len() - learned_in).div_ceil(N_BLOCKS);
    fly(flight, ObserverEstimator(assemble::rigid_body(&config)?, Learn::ALL), |index, finding| {
        let Some(after) = index.checked_sub(learned_in) else { return };
        let block = &mut sums[after / length];
        match finding {
            Finding::Coast(_, error) => block[0].add(&error),
            Finding::NextSample(error) => block[1].add(&error),
        }
    })?;
    Ok(sums.iter().map(|[coast, step]| [coast.mean(), step.mean()]).collect())
}

/// Geometric mean of the errors' norms.
#[derive(Default)]
struct MeanLog {
    sum: f64,
    count: usize,
}

impl MeanLog {
    fn add(&mut self, error: &Vector3<f64>) {
        self.sum += error.norm().max(MIN_ERROR_M_S).ln();
        self.count += 1;
    }

    fn mean(&self) -> f64 {
        (self.sum / self.count as f64).exp()
    }
}

/// The first lines of the written configuration.
fn head(document: &Document) -> String {
    let [before, after] = document.second_half;
    let [trained_before, trained_after] = document.tuned_on;
    format!(
        "# Tuned by `bench tune` on the first half of {}, starting from {}.\n\
         # Coast of {} s: {:.4} m/s before, {:.4} after, on the second half, which the search never saw;\n\
         # {:.4} and {:.4} on the half it was tuned on. Next sample: {:.4} and {:.4} m/s on the second half.\n",
        document.file,
        document.start,
        document.coast_s,
        before.coast_rms_m_s,
        after.coast_rms_m_s,
        trained_before.coast_rms_m_s,
        trained_after.coast_rms_m_s,
        before.one_step_rms_m_s,
        after.one_step_rms_m_s,
    )
}

fn print(document: &Document) {
    let Values { centers_lower_m_s: lower, centers_upper_m_s: upper, centers_per_axis: n, .. } =
        document.values;
    outln!(
        "{}, from {}: {} configurations tried, {} refused\n\
         mass {:.3} kg, gain {:.3} 1/s, adaptation rate {:.3} kg/s², length scale {:.3} m/s, dead zone {:.4} m/s,\n\
         centers {} × {} × {} from {lower:.2?} to {upper:.2?} m/s",
        document.file,
        document.start,
        document.evaluations,
        document.refused_as_unstable_or_out_of_bounds,
        document.values.mass_kg,
        document.values.gain_per_s,
        document.values.adaptation_rate_kg_s2,
        document.values.length_scale_m_s,
        document.values.dead_zone_width_m_s,
        n[0],
        n[1],
        n[2],
    );
    let coast = format!("{} s coast (m/s)", document.coast_s);
    let rows = [
        ("first half, tuned on: before", document.tuned_on[0]),
        ("first half, tuned on: after", document.tuned_on[1]),
        ("second half, never seen: before", document.second_half[0]),
        ("second half, never seen: after", document.second_half[1]),
        ("second half, Kalman filter, best of 14", document.kalman_second_half),
    ];
    let rows = rows.map(|(name, errors)| {
        let [step, coast] = [errors.one_step_rms_m_s, errors.coast_rms_m_s].map(|v| format!("{v:.4}"));
        [name.to_owned(), step, coast]
    });
    outln!("{}", table(&["RMS of the velocity error's norm", "next sample (m/s)", &coast], 1, rows));
    outln!(
        "cross-validated over time: {:.2} times the start's errors on thirds that did not choose; price of distance {}",
        document.cross_validated_ratio,
        document.price,
    );
    match &document.written {
        Some(file) => outln!("written to '{file}'"),
        None => outln!(
            "not better on the second half: nothing is written. Keep {}, or tune on a flight that moves more alike in both halves",
            document.start
        ),
    }
}
