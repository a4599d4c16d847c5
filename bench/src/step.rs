//! `bench step`: what one whole step of a channel costs, as the number of centers N grows.
//!
//! Three contestants take turns in small batches of one run, so that a clock that slows down or a
//! neighbour that wakes up hits all of them alike:
//!
//! | name | what a step is |
//! |---|---|
//! | ours | [`observer::Channel::step`] |
//! | literal | the same law as it is printed, with nalgebra: 3×3N and 3N×3N matrices, left to right |
//! | Kalman | adskalman's filter with 6 states (velocity, disturbance) and 3 outputs |
//!
//! Each step is timed on its own, the clock's cost included and printed beside the figures. Before that,
//! ours and the literal formula must have found the same force: two different things are not compared.

use crate::machine::Machine;
use crate::plot::{self, Line, LineStyle, Panel};
use adskalman::{
    KalmanFilterNoControl, ObservationModel, StateAndCovariance, TransitionModelLinearNoControl,
};
use anyhow::{Context, anyhow, bail};
use comfy_table::{CellAlignment, Table, presets};
use indicatif::{ProgressBar, ProgressStyle};
use nalgebra::{
    DMatrix, DVector, Matrix3, Matrix3x6, Matrix3xX, Matrix6, Matrix6x3, U3, U6, Vector3, Vector6,
};
use observer::{
    Centers, Channel, ChannelDesign, DeadZone, DeadZoneShape, DisturbanceBounds, Kernel, Learning,
    LengthScale, RadialFunction,
};
use serde::Serialize;
use shared_types::{logln, outln};
use std::f64::consts::TAU;
use std::hint::black_box;
use std::path::PathBuf;
use std::time::{Duration, Instant};

/// Latency of one channel step by number of centers, against the paper's formula written out and a Kalman
/// filter.
#[derive(Debug, Clone, clap::Args)]
pub struct StepArguments {
    /// Numbers of centers; cubes are laid out as a lattice, others as a quasi-random set.
    #[arg(
        long,
        value_name = "N,N,…",
        value_delimiter = ',',
        default_value = "27,125,343,729,1000",
        value_parser = parse_n_centers
    )]
    pub centers: Vec<usize>,
    /// Steps to time for each number of centers.
    #[arg(long, value_name = "COUNT", default_value_t = 20_000, value_parser = clap::value_parser!(u32).range(1..=10_000_000))]
    pub samples: u32,
    /// Stop a size after this long, with fewer samples.
    #[arg(long, value_name = "SECONDS", default_value_t = 8.0, value_parser = parse_seconds)]
    pub seconds_per_size: f64,
    /// Run the literal formula up to this N: its matrix takes 72 N² bytes, and every step reads all of it.
    #[arg(long, value_name = "N", default_value_t = 343)]
    pub literal_up_to: usize,
    /// Print one JSON document instead of the table.
    #[arg(long)]
    pub json: bool,
    /// Draw the latencies to FILE, .svg or .png.
    #[arg(long, value_name = "FILE")]
    pub plot: Option<PathBuf>,
}

/// 10 000 centers take 0.4 GB once factored, and three times that while they are.
const MOST_CENTERS: usize = 10_000;

fn parse_n_centers(text: &str) -> Result<usize, String> {
    match text.trim().parse() {
        Ok(n) if (1..=MOST_CENTERS).contains(&n) => Ok(n),
        _ => Err(format!("needed: a number of centers from 1 to {MOST_CENTERS}")),
    }
}

fn parse_seconds(text: &str) -> Result<f64, String> {
    match text.trim().parse() {
        Ok(seconds) if (1e-3..=86_400.0).contains(&seconds) => Ok(seconds),
        _ => Err("needed: a number of seconds from 0.001 to 86400".into()),
    }
}

/// Measures, and prints the table or the JSON document.
///
/// Pins the calling thread to the core it runs on, and leaves it there.
///
/// # Errors
/// A plot that cannot be written (asked before measuring), centers that make no design, or two formulas
/// that disagree.
pub fn run(arguments: &StepArguments) -> anyhow::Result<()> {
    if let Some(file) = &arguments.plot {
        plot::check_target(file)?;
    }
    if cfg!(debug_assertions) {
        logln!("warning: this is a debug build, its latencies mean nothing; use cargo run --release");
    }
    let machine = Machine::found();
    let progress = progress_bar(arguments.centers.len());
    let mut rows = Vec::with_capacity(arguments.centers.len());
    for &n_centers in &arguments.centers {
        progress.set_message(format!("N = {n_centers}"));
        rows.push(measure(n_centers, arguments, &progress).with_context(|| format!("N = {n_centers}"))?);
    }
    progress.finish_and_clear();

    if arguments.json {
        outln!("{}", serde_json::to_string_pretty(&Report { machine: &machine, rows: &rows })?);
    } else {
        print_table(&machine, &rows);
    }
    if let Some(file) = &arguments.plot {
        draw(file, &rows)?;
        if !arguments.json {
            outln!("plot: {}", file.display());
        }
    }
    Ok(())
}

/// Silent where stderr is not a terminal.
fn progress_bar(n_sizes: usize) -> ProgressBar {
    let style = ProgressStyle::with_template("{msg:12} {bar:40} {elapsed} of about {duration}");
    ProgressBar::new((n_sizes * ROUNDS) as u64)
        .with_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()))
}

// The paper's translation channel (§VI-C): m = 4 kg, λ = 10 /s, Γ = 100 kg/s², k = 3, ℓ = 1 m/s.
const KERNEL: Kernel = Kernel::SobolevMatern { dimension: 3, order: 3 };
const LENGTH_SCALE: f64 = 1.0;
const MASS_KG: f64 = 4.0;
const GAIN_PER_S: f64 = 10.0;
const ADAPTATION_RATE: f64 = 100.0;
const DEAD_ZONE_WIDTH: f64 = 0.01;
const STEP_S: f64 = 0.005;

fn dead_zone() -> anyhow::Result<DeadZone> {
    Ok(DeadZone::new(DeadZoneShape::Saturated, DEAD_ZONE_WIDTH, DEAD_ZONE_WIDTH)?)
}

fn channel(centers: Centers) -> anyhow::Result<Channel> {
    Ok(Channel::new(&ChannelDesign {
        kernel: KERNEL,
        length_scale: LengthScale::Isotropic(LENGTH_SCALE),
        centers,
        nugget: 0.0,
        inertia: Matrix3::identity() * MASS_KG,
        gain_per_s: GAIN_PER_S,
        adaptation_rate: Matrix3::identity() * ADAPTATION_RATE,
        dead_zone: dead_zone()?,
        bounds: DisturbanceBounds::default(),
        hold_s: STEP_S,
        coast_step_s: STEP_S,
    })?)
}

/// N centers on [−1, 1]³, and what to call them.
fn centers(n_centers: usize) -> anyhow::Result<(Centers, String)> {
    let edge = (n_centers as f64).cbrt().round() as usize;
    if edge.pow(3) == n_centers {
        let lattice = Centers::lattice([-1.0; 3], [1.0; 3], [edge; 3])?;
        return Ok((lattice, format!("lattice {edge}³")));
    }
    // Roberts' R₃ sequence, whose points keep a distance of the order of N^{−1/3}; random ones would come so
    // close that the Gram matrix is singular. The seed is the first point, the middle of the box.
    let ratio = 1.220_744_084_605_759_5_f64; // x⁴ = x + 1
    let point = |i: usize| -> [f64; 3] {
        std::array::from_fn(|axis| 2.0 * (0.5 + i as f64 * ratio.powi(-(axis as i32 + 1))).fract() - 1.0)
    };
    Ok((Centers::listed((0..n_centers).map(point).collect::<Vec<_>>())?, "quasi-random".into()))
}

/// A closed curve through [−0.9, 0.9]³, one output every step of 5 ms. It moves at 2 to 3 m/s², so that an
/// estimate with λ = 10 /s trails it by ten times the dead zone.
fn wandering_outputs() -> Vec<Vector3<f64>> {
    const PERIOD: usize = 8192;
    let at = |i: usize| TAU * i as f64 / PERIOD as f64;
    (0..PERIOD)
        .map(|i| {
            0.9 * Vector3::new((13.0 * at(i)).sin(), (17.0 * at(i) + 1.0).sin(), (23.0 * at(i) + 2.0).sin())
        })
        .collect()
}

/// The law as the paper prints it, on 3N coefficients:
///
/// ```text
/// α̂' = σ(‖ỹ‖) Γ 𝕂⁻¹ 𝒦_Ξ(y)ᵀ ỹ,    f̂ = 𝒦_Ξ(y) α̂
/// ```
///
/// | symbol | name | shape |
/// |---|---|---|
/// | 𝒦_Ξ(y) = [κ₁ I₃ … κ_N I₃] | `kernel_operator` | 3×3N |
/// | 𝕂⁻¹ = K⁻¹ ⊗ I₃ | `gram_inverse` | 3N×3N |
/// | α̂ | `coefficients` | 3N |
///
/// 𝕂⁻¹ is made beforehand, and the scalar Γ comes last, so that no step is charged for scaling a matrix.
struct LiteralChannel {
    kernel: RadialFunction,
    centers: Vec<Vector3<f64>>,
    gram_inverse: DMatrix<f64>,
    coefficients: DVector<f64>,
    dead_zone: DeadZone,
}

impl LiteralChannel {
    fn new(channel: &Channel) -> anyhow::Result<Self> {
        let space = channel.law.space();
        let gram = space.gram();
        let inverse = gram.cholesky().context("the Gram matrix is not positive definite")?.inverse();
        Ok(Self {
            kernel: KERNEL.radial(3)?,
            centers: space.centers().points().map(Vector3::from_column_slice).collect(),
            gram_inverse: inverse.kronecker(&Matrix3::identity()),
            coefficients: DVector::zeros(3 * space.n_centers()),
            dead_zone: dead_zone()?,
        })
    }

    fn kernel_operator(&self, y: &Vector3<f64>) -> Matrix3xX<f64> {
        let mut operator = Matrix3xX::zeros(3 * self.centers.len());
        for (j, center) in self.centers.iter().enumerate() {
            let kernel = self.kernel.value((center - y).norm() / LENGTH_SCALE);
            operator.fixed_view_mut::<3, 3>(0, 3 * j).fill_diagonal(kernel);
        }
        operator
    }

    /// v̂ after one step, and f̂(y).
    fn step(
        &mut self,
        estimate: &Vector3<f64>,
        output: &Vector3<f64>,
        input: &Vector3<f64>,
    ) -> (Vector3<f64>, Vector3<f64>) {
        let output_error = output - estimate;
        let activation = self.dead_zone.activation(output_error.norm());
        let kernel_operator = self.kernel_operator(output);
        let coefficients_rate =
            &self.gram_inverse * kernel_operator.transpose() * output_error * (ADAPTATION_RATE * activation);
        self.coefficients += coefficients_rate * STEP_S;
        let matched_force = &kernel_operator * &self.coefficients;
        let decay = (-GAIN_PER_S * STEP_S).exp();
        let driving = GAIN_PER_S * output + (input + matched_force) / MASS_KG;
        (decay * estimate + (1.0 - decay) / GAIN_PER_S * driving, matched_force)
    }
}

/// Velocity and a disturbance acceleration that wanders at random, seen through the velocity: what one
/// would use who does not model the force.
struct DisturbanceModel {
    transition: Matrix6<f64>,
    transition_transposed: Matrix6<f64>,
    process_noise: Matrix6<f64>,
}

impl TransitionModelLinearNoControl<f64, U6> for DisturbanceModel {
    fn F(&self) -> &Matrix6<f64> {
        &self.transition
    }
    fn FT(&self) -> &Matrix6<f64> {
        &self.transition_transposed
    }
    fn Q(&self) -> &Matrix6<f64> {
        &self.process_noise
    }
}

struct VelocityObservation {
    observation: Matrix3x6<f64>,
    observation_transposed: Matrix6x3<f64>,
    noise: Matrix3<f64>,
}

impl ObservationModel<f64, U6, U3> for VelocityObservation {
    fn H(&self) -> &Matrix3x6<f64> {
        &self.observation
    }
    fn HT(&self) -> &Matrix6x3<f64> {
        &self.observation_transposed
    }
    fn R(&self) -> &Matrix3<f64> {
        &self.noise
    }
}

impl DisturbanceModel {
    fn new() -> Self {
        let mut transition = Matrix6::identity();
        transition.fixed_view_mut::<3, 3>(0, 3).fill_diagonal(STEP_S);
        let process_noise = Matrix6::from_diagonal(&Vector6::from_fn(|i, _| if i < 3 { 1e-6 } else { 1e-3 }));
        Self { transition, transition_transposed: transition.transpose(), process_noise }
    }
}

impl VelocityObservation {
    fn new() -> Self {
        let mut observation = Matrix3x6::zeros();
        observation.fixed_view_mut::<3, 3>(0, 0).fill_diagonal(1.0);
        Self {
            observation,
            observation_transposed: observation.transpose(),
            noise: Matrix3::identity() * 1e-4,
        }
    }
}

/// The two formulas are compared over this many steps.
const CHECKED_STEPS: usize = 100;
/// Of the largest force. Rounding enters with the condition of the Gram matrix and the explicit inverse; up
/// to N = 343 it left 5e-14, so that this leaves room for some thousand centers.
const TOLERANCE: f64 = 1e-9;

/// The largest difference of the forces over the first steps, relative to the largest force.
///
/// # Errors
/// A difference beyond the tolerance.
fn check_agreement(
    channel: &mut Channel,
    literal: &mut LiteralChannel,
    outputs: &[Vector3<f64>],
) -> anyhow::Result<f64> {
    let (mut ours, mut theirs) = (Vector3::zeros(), Vector3::zeros());
    let (mut difference, mut largest): (f64, f64) = (0.0, 0.0);
    for output in &outputs[..CHECKED_STEPS] {
        ours = channel.step(&ours, output, &INPUT, STEP_S);
        let (our_force, _) = channel.law.matched_force_at(output, &Learning::none());
        let their_force;
        (theirs, their_force) = literal.step(&theirs, output, &INPUT);
        difference = difference.max((our_force - their_force).amax()).max((ours - theirs).amax());
        largest = largest.max(their_force.amax());
    }
    let relative = difference / largest;
    if relative.is_nan() || relative > TOLERANCE {
        bail!(
            "ours and the literal formula differ by {relative:.1e} of the force after {CHECKED_STEPS} steps; \
             needed: at most {TOLERANCE:.0e}. One of them is wrong, or the Gram matrix is too badly \
             conditioned (here {:.1e}) to compare them: choose fewer centers or a lower --literal-up-to",
            channel.law.space().gram_condition()
        );
    }
    Ok(relative)
}

/// u, constant.
const INPUT: Vector3<f64> = Vector3::new(2.0, -1.0, 0.5);

/// A size is measured in this many rounds, each with a batch of every contestant.
const ROUNDS: usize = 100;
/// Even a slow machine gets this many rounds.
const LEAST_ROUNDS: usize = 10;
/// A batch of another contestant takes no longer than this.
const BATCH_NS: u64 = 10_000_000;
/// Steps at the head of each batch that are not timed: they bring back what the others pushed out of the
/// caches.
const UNTIMED_STEPS: usize = 3;
const WARM_UP: Duration = Duration::from_millis(100);
/// Steps before that, in which the learning ones are counted.
const COUNTED_STEPS: usize = 1000;

/// One contestant: its step on the i-th output, and how long each took.
struct Contestant<F> {
    step: F,
    /// Counts steps, timed or not.
    at: usize,
    samples_ns: Vec<u64>,
}

impl<F: FnMut(usize)> Contestant<F> {
    fn new(step: F, most_samples: usize) -> Self {
        // Reserved and touched, so that no page is mapped while the clock runs.
        let mut samples_ns = vec![1; most_samples];
        samples_ns.clear();
        Self { step, at: 0, samples_ns }
    }

    /// Runs for a while, and returns the median of the steps.
    fn warm_up(&mut self) -> u64 {
        let started = Instant::now();
        while started.elapsed() < WARM_UP || self.samples_ns.is_empty() {
            self.time_one();
        }
        self.samples_ns.sort_unstable();
        let median = quantile(&self.samples_ns, 0.5);
        self.samples_ns.clear();
        median
    }

    fn time_one(&mut self) {
        let started = Instant::now();
        (self.step)(self.at);
        let elapsed = started.elapsed();
        self.samples_ns.push(elapsed.as_nanos() as u64);
        self.at += 1;
    }

    fn batch(&mut self, n_steps: usize) {
        for _ in 0..UNTIMED_STEPS {
            (self.step)(self.at);
            self.at += 1;
        }
        (0..n_steps).for_each(|_| self.time_one());
    }

    fn median(&mut self) -> u64 {
        self.samples_ns.sort_unstable();
        quantile(&self.samples_ns, 0.5)
    }
}

/// The smallest sample that a share `q` of all samples does not exceed (nearest rank).
///
/// # Panics
/// Without samples.
fn quantile(sorted: &[u64], q: f64) -> u64 {
    let rank = (q * sorted.len() as f64).ceil() as usize;
    sorted[rank.clamp(1, sorted.len()) - 1]
}

/// One size. The keys are those that scripts rely on, and more.
#[derive(Debug, Serialize)]
struct Row {
    solver: &'static str,
    n_centers: usize,
    centers: String,
    samples: usize,
    median_ns: u64,
    p99_ns: u64,
    p999_ns: u64,
    max_ns: u64,
    median_ns_per_center: f64,
    bytes: usize,
    /// Share of the first steps that learned.
    dead_zone_open: f64,
    literal_median_ns: Option<u64>,
    literal_samples: usize,
    literal_ratio: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    literal_ratio_reason: Option<String>,
    /// Largest difference between our force and the literal one, relative to the force.
    literal_force_difference: Option<f64>,
    kalman_median_ns: u64,
    kalman_samples: usize,
    kalman_ratio: f64,
}

fn measure(n_centers: usize, arguments: &StepArguments, progress: &ProgressBar) -> anyhow::Result<Row> {
    let outputs = wandering_outputs();
    let output = |i: usize| &outputs[i % outputs.len()];
    let (centers, centers_kind) = centers(n_centers)?;
    let mut channel = channel(centers)?;
    let bytes = channel.law.space().bytes();

    let mut literal = match n_centers <= arguments.literal_up_to {
        true => Some(LiteralChannel::new(&channel)?),
        false => None,
    };
    let literal_force_difference =
        literal.as_mut().map(|literal| check_agreement(&mut channel, literal, &outputs)).transpose()?;

    let n_samples = arguments.samples as usize;
    let batch = n_samples.div_ceil(ROUNDS);
    // The warm-up of the fastest contestant takes some 10⁶ steps.
    let reserved = n_samples.max(1 << 21);

    let (mut estimate, mut literal_estimate, input) = (Vector3::zeros(), Vector3::zeros(), INPUT);
    let mut n_open = 0;
    for i in 0..COUNTED_STEPS {
        estimate = channel.step(&estimate, output(i), &input, STEP_S);
        n_open += usize::from(channel.law.output_error().norm() > DEAD_ZONE_WIDTH);
    }
    let mut ours = Contestant::new(
        |i| {
            estimate = channel.step(black_box(&estimate), black_box(output(i)), black_box(&input), STEP_S);
        },
        reserved,
    );
    let mut theirs = literal.as_mut().map(|literal| {
        let step = |i| {
            literal_estimate =
                literal.step(black_box(&literal_estimate), black_box(output(i)), black_box(&input)).0;
        };
        Contestant::new(step, reserved)
    });
    let (model, observation) = (DisturbanceModel::new(), VelocityObservation::new());
    let filter = KalmanFilterNoControl::new(&model, &observation);
    let mut belief = StateAndCovariance::new(Vector6::zeros(), Matrix6::identity());
    let mut failed = None;
    let mut kalman = Contestant::new(
        |i| match filter.step(black_box(&belief), black_box(output(i))) {
            Ok(next) => belief = next,
            Err(error) => failed = Some(error),
        },
        reserved,
    );

    ours.warm_up();
    let others_batch = |median: u64| (BATCH_NS / median.max(1)).clamp(1, batch as u64) as usize;
    let literal_batch = theirs.as_mut().map(|theirs| others_batch(theirs.warm_up()));
    let kalman_batch = others_batch(kalman.warm_up());

    let (started, budget) = (Instant::now(), Duration::from_secs_f64(arguments.seconds_per_size));
    for round in 0..ROUNDS {
        let missing = n_samples - ours.samples_ns.len();
        if missing == 0 || (round >= LEAST_ROUNDS && started.elapsed() > budget) {
            progress.inc((ROUNDS - round) as u64);
            break;
        }
        ours.batch(batch.min(missing));
        if let (Some(theirs), Some(n_steps)) = (&mut theirs, literal_batch) {
            theirs.batch(n_steps);
        }
        kalman.batch(kalman_batch);
        progress.inc(1);
    }

    let median_ns = ours.median();
    let ratio = |theirs: u64| theirs as f64 / median_ns as f64;
    let literal_median_ns = theirs.as_mut().map(Contestant::median);
    let literal_samples = theirs.as_ref().map_or(0, |theirs| theirs.samples_ns.len());
    let (kalman_median_ns, kalman_samples) = (kalman.median(), kalman.samples_ns.len());
    let samples_ns = ours.samples_ns;
    if let Some(error) = failed {
        return Err(anyhow!("the Kalman filter failed, so its time means nothing: {error}"));
    }
    Ok(Row {
        solver: "dense",
        n_centers,
        centers: centers_kind,
        samples: samples_ns.len(),
        median_ns,
        p99_ns: quantile(&samples_ns, 0.99),
        p999_ns: quantile(&samples_ns, 0.999),
        max_ns: quantile(&samples_ns, 1.0),
        median_ns_per_center: median_ns as f64 / n_centers as f64,
        bytes,
        dead_zone_open: n_open as f64 / COUNTED_STEPS as f64,
        literal_median_ns,
        literal_samples,
        literal_ratio: literal_median_ns.map(ratio),
        literal_ratio_reason: literal_median_ns.is_none().then(|| {
            format!(
                "not run beyond N = {} (--literal-up-to): its matrix would take {:.0} MB",
                arguments.literal_up_to,
                72e-6 * (n_centers as f64).powi(2)
            )
        }),
        literal_force_difference,
        kalman_median_ns,
        kalman_samples,
        kalman_ratio: ratio(kalman_median_ns),
    })
}

#[derive(Debug, Serialize)]
struct Report<'a> {
    machine: &'a Machine,
    rows: &'a [Row],
}

fn print_table(machine: &Machine, rows: &[Row]) {
    machine.print();
    let mut table = Table::new();
    table.load_style(presets::UTF8_FULL_CONDENSED).set_header([
        "N",
        "centers",
        "kB",
        "samples",
        "median (µs)",
        "p99 (µs)",
        "p99.9 (µs)",
        "max (µs)",
        "ns/center",
        "literal/ours",
        "Kalman/ours",
    ]);
    let microseconds = |ns: u64| three_digits(ns as f64 * 1e-3);
    for row in rows {
        table.add_row([
            row.n_centers.to_string(),
            row.centers.clone(),
            three_digits(row.bytes as f64 * 1e-3),
            row.samples.to_string(),
            microseconds(row.median_ns),
            microseconds(row.p99_ns),
            microseconds(row.p999_ns),
            microseconds(row.max_ns),
            three_digits(row.median_ns_per_center),
            row.literal_ratio.map_or("not run".into(), three_digits),
            three_digits(row.kalman_ratio),
        ]);
    }
    for column in table.column_iter_mut().enumerate().filter(|(i, _)| *i != 1).map(|(_, column)| column) {
        column.set_cell_alignment(CellAlignment::Right);
    }
    outln!("{table}");
    outln!(
        "kB: what a step reads of the factor and the centers. Ratios are their median over ours, from the same run."
    );
    if let Some(worst) = rows.iter().filter_map(|row| row.literal_force_difference).reduce(f64::max) {
        outln!(
            "Literal: the paper's formula with 3N×3N matrices; its force and ours differ by at most {worst:.1e} of the force."
        );
    }
    if let Some(reason) = rows.iter().find_map(|row| row.literal_ratio_reason.as_ref()) {
        outln!("Literal: {reason}.");
    }
    outln!("Kalman: adskalman, 6 states and 3 outputs, whatever N is.");
    let open = rows.iter().map(|row| row.dead_zone_open).fold(1.0, f64::min);
    outln!("Smallest share of our steps outside of the dead zone, that is, learning: {:.1} %.", 100.0 * open);
}

fn three_digits(value: f64) -> String {
    match value {
        _ if value < 0.9995 => format!("{value:.3}"),
        _ if value < 9.995 => format!("{value:.2}"),
        _ if value < 99.95 => format!("{value:.1}"),
        _ => format!("{value:.0}"),
    }
}

fn draw(file: &std::path::Path, rows: &[Row]) -> anyhow::Result<()> {
    let mut rows: Vec<&Row> = rows.iter().collect();
    rows.sort_by_key(|row| row.n_centers);
    let line = |label: &str, style, latency_ns: &dyn Fn(&Row) -> Option<f64>| {
        let point = |row: &&Row| Some((row.n_centers as f64, 1e-3 * latency_ns(row)?));
        Line { label: label.into(), points: rows.iter().filter_map(point).collect(), style }
    };
    let (Some(first), Some(last)) = (rows.first(), rows.last()) else { return Ok(()) };
    let scaled = |from: &Row, row: &Row, power: i32| {
        Some(from.median_ns as f64 * (row.n_centers as f64 / from.n_centers as f64).powi(power))
    };
    let panel = Panel {
        y_label: "latency of one step (µs)".into(),
        lines: vec![
            line("ours, median", LineStyle::Estimate, &|row| Some(row.median_ns as f64)),
            line("ours, p99", LineStyle::Estimate, &|row| Some(row.p99_ns as f64)),
            line("literal formula, median", LineStyle::Comparison, &|row| {
                row.literal_median_ns.map(|ns| ns as f64)
            }),
            line("Kalman filter, median", LineStyle::Comparison, &|row| Some(row.kalman_median_ns as f64)),
            line("∝ N", LineStyle::Guide, &|row| scaled(first, row, 1)),
            line("∝ N²", LineStyle::Guide, &|row| scaled(last, row, 2)),
        ],
        log_x: true,
        log_y: true,
    };
    plot::draw_to(file, "One step of a channel by number of centers", "number of centers N", &[panel])
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::Parser;

    #[derive(Parser)]
    struct CommandLine {
        #[command(flatten)]
        step: StepArguments,
    }

    fn arguments(words: &[&str]) -> Result<StepArguments, clap::Error> {
        CommandLine::try_parse_from(["step"].iter().chain(words)).map(|line| line.step)
    }

    #[test]
    fn a_list_of_centers_is_split_at_commas() {
        assert_eq!(arguments(&[]).unwrap().centers, [27, 125, 343, 729, 1000]);
        assert_eq!(arguments(&["--centers", "8, 50,27"]).unwrap().centers, [8, 50, 27]);
        for bad in ["0", "8,,27", "8;27", "-1", "100000"] {
            assert!(arguments(&["--centers", bad]).is_err(), "{bad}");
        }
        assert!(arguments(&["--samples", "0"]).is_err());
        assert!(arguments(&["--seconds-per-size", "nan"]).is_err());
    }

    /// With 1…1000 in order, a share q of the samples does not exceed 1000 q.
    #[test]
    fn quantiles_are_samples_of_the_nearest_rank() {
        let sorted: Vec<u64> = (1..=1000).collect();
        let found = [0.5, 0.99, 0.999, 1.0, 0.0].map(|q| quantile(&sorted, q));
        assert_eq!(found, [500, 990, 999, 1000, 1]);
        assert_eq!(quantile(&[7], 0.999), 7);
        assert_eq!(quantile(&[1, 9], 0.5), 1);
    }

    #[test]
    fn ours_and_the_literal_formula_find_the_same_force() {
        let outputs = wandering_outputs();
        for n_centers in [1, 8, 20, 27, 64] {
            let mut channel = channel(centers(n_centers).unwrap().0).unwrap();
            let mut literal = LiteralChannel::new(&channel).unwrap();
            let difference = check_agreement(&mut channel, &mut literal, &outputs).unwrap();
            assert!(difference < TOLERANCE, "N = {n_centers}: {difference:e}");
            assert!(channel.law.native_norm() > 1.0, "nothing was learned");
        }
    }

    #[test]
    fn a_formula_that_differs_is_refused() {
        let mut channel = channel(centers(27).unwrap().0).unwrap();
        let mut literal = LiteralChannel::new(&channel).unwrap();
        literal.gram_inverse *= 1.0 + 1e-6;
        let error = check_agreement(&mut channel, &mut literal, &wandering_outputs()).unwrap_err();
        assert!(error.to_string().contains("differ by"), "{error}");
    }

    #[test]
    fn centers_that_are_no_cube_are_still_well_separated() {
        for n_centers in [2, 50, 200, 500] {
            let (centers, kind) = centers(n_centers).unwrap();
            assert_eq!((centers.n_centers(), kind.as_str()), (n_centers, "quasi-random"));
            let (.., distance) = centers.closest_pair(&[1.0; 3]).unwrap();
            assert!(distance > 0.5 * (n_centers as f64).cbrt().recip(), "N = {n_centers}: {distance}");
            channel(centers).unwrap();
        }
        assert_eq!(centers(125).unwrap().1, "lattice 5³");
    }

    /// Not the times, which are the machine's affair: every figure is there and they are in order.
    #[test]
    fn a_short_measurement_fills_its_rows() {
        let arguments =
            arguments(&["--centers", "8,20", "--samples", "250", "--literal-up-to", "8"]).unwrap();
        let rows: Vec<_> = (arguments.centers.iter())
            .map(|&n| measure(n, &arguments, &ProgressBar::hidden()).unwrap())
            .collect();
        for row in &rows {
            assert_eq!(row.samples, 250);
            assert!(row.median_ns <= row.p99_ns && row.p99_ns <= row.p999_ns && row.p999_ns <= row.max_ns);
            assert!(row.dead_zone_open > 0.9, "{}", row.dead_zone_open);
        }
        let json = serde_json::to_value(&rows).unwrap();
        assert!(json[0]["literal_ratio"].is_number() && json[0]["literal_ratio_reason"].is_null());
        assert!(json[1]["literal_ratio"].is_null() && json[1]["literal_ratio_reason"].is_string());

        let directory = tempfile::tempdir().unwrap();
        let file = directory.path().join("step.svg");
        draw(&file, &rows).unwrap();
        assert!(std::fs::read_to_string(file).unwrap().contains("literal formula"));
    }
}
