use super::*;
use crate::PriorDeviations;
use crate::designs::joint_law;
use crate::{Centers, LengthScale};

const PERIOD_NS: u64 = 5_000_000;
const NOISE_M_S: f64 = 0.05;
const MASS_KG: f64 = 2.0;

fn design() -> JointChannelDesign {
    let filter = JointDesign {
        length_scale: LengthScale::Isotropic(4.0),
        centers: Centers::lattice([-4.0; 3], [4.0; 3], [3; 3]).unwrap(),
        ..joint_law([NOISE_M_S; 3])
    };
    JointChannelDesign { filter, inertia: Matrix3::identity() * MASS_KG, hold_s: 0.0075 }
}

fn channel() -> JointChannel<()> {
    let design = JointTranslationDesign {
        channel: design(),
        known_force_n: Vector3::zeros(),
        gravity_m_s2: Vector3::zeros(),
    };
    JointChannel::translation(&design, None, None).unwrap()
}

struct Random(u64);

impl Random {
    fn normal(&mut self) -> f64 {
        let uniform = |seed: &mut u64| {
            *seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (*seed >> 11) as f64 / (1_u64 << 53) as f64
        };
        (0..12).map(|_| uniform(&mut self.0)).sum::<f64>() - 6.0
    }
}

/// A vehicle that holds a moving reference against a drag and a wind that it was not told of.
struct Flight {
    random: Random,
    velocity: Vector3<f64>,
    gust: Vector3<f64>,
    phases: Vector3<f64>,
}

impl Flight {
    fn new(seed: u64) -> Self {
        let mut random = Random(seed);
        let phases = Vector3::from_fn(|_, _| 3.0 * random.normal());
        Self { random, velocity: Vector3::zeros(), gust: Vector3::zeros(), phases }
    }

    fn unknown_n(&self) -> Vector3<f64> {
        let air = self.velocity - Vector3::new(1.5, -0.5, 0.0);
        -0.25 * air.norm() * air
    }

    fn command_n(&self, t_s: f64) -> Vector3<f64> {
        let wave = |axis: usize, rate: f64| (rate * t_s + self.phases[axis]).sin();
        let reference = Vector3::new(2.5 * wave(0, 0.9), 2.0 * wave(1, 0.7), 0.8 * wave(2, 1.3));
        4.0 * (reference - self.velocity)
    }

    /// The process noise that the filter is told of, and the Gauss–Markov disturbance.
    fn advance(&mut self, command_n: &Vector3<f64>, h_s: f64) {
        for axis in 0..3 {
            let decay = (-h_s / 0.2_f64).exp();
            self.gust[axis] =
                decay * self.gust[axis] + 0.1 * (1.0 - decay * decay).sqrt() * self.random.normal();
        }
        let substeps = 5;
        let dt = h_s / f64::from(substeps);
        for _ in 0..substeps {
            let a = (command_n + self.unknown_n()) / MASS_KG + self.gust;
            self.velocity += dt * a;
        }
        let white = (1.5e-3 * h_s).sqrt();
        self.velocity += Vector3::from_fn(|_, _| white * self.random.normal());
    }

    fn measured(&mut self) -> [Option<f64>; 3] {
        std::array::from_fn(|axis| Some(self.velocity[axis] + NOISE_M_S * self.random.normal()))
    }
}

/// Who asks, and when, changes nothing.
#[test]
fn the_same_samples_give_the_same_bits_whoever_asks() {
    let (mut asked, mut silent) = (channel(), channel());
    let mut flight = Flight::new(3);
    for j in 0..3000_u64 {
        let stamp_ns = 1_000_000_000 + j * PERIOD_NS;
        let command = flight.command_n(j as f64 * 0.005);
        // A gap of everything, an outage of the velocity, a slow sensor.
        let is_gap = (1000..1600).contains(&j);
        let has_output = !(2000..2200).contains(&j) && j % 3 == 0;
        if !is_gap {
            let output = if has_output { flight.measured() } else { [None; 3] };
            let sample = JointSample { output, command: Some(command), ..JointSample::default() };
            let teaches = if (700..800).contains(&j) { Teaches::State } else { Teaches::All };
            for channel in [&mut asked, &mut silent] {
                channel.accept(stamp_ns, &sample, teaches, None::<fn(&mut ())>);
            }
        }
        for later_ns in [0, 1_700_000, (j % 7) * 60_000_000, 4_000_000] {
            asked.estimate(stamp_ns + later_ns);
        }
        flight.advance(&command, 0.005);
    }
    let later_ns = 1_000_000_000 + 3010 * PERIOD_NS;
    let [a, b] = [&mut asked, &mut silent].map(|channel| format!("{:?}", channel.estimate(later_ns)));
    assert_eq!(a, b);
    assert_eq!(asked.at.state.mean, silent.at.state.mean);
    assert_eq!(asked.at.state.covariances[0], silent.at.state.covariances[0]);
}

/// White noise as configured: the errors are as large as the deviations say, sample by sample and after outages.
#[test]
fn over_fifty_seeds_the_deviations_are_honest() {
    let (mut nees, mut nis, mut n) = (0.0, 0.0, 0.0);
    let (mut within, mut coasts) = (0.0, 0.0);
    for seed in 1..=50 {
        let mut channel = channel();
        let mut flight = Flight::new(seed);
        for j in 0..6000_u64 {
            let stamp_ns = 1_000_000_000 + j * PERIOD_NS;
            let command = flight.command_n(j as f64 * 0.005);
            // From 15 s on 0.5 s without velocity in every 2 s.
            let is_outage = j >= 3000 && j % 400 < 100;
            let output = if is_outage { [None; 3] } else { flight.measured() };
            let sample = JointSample { output, command: Some(command), ..JointSample::default() };
            let agreement = channel.accept(stamp_ns, &sample, Teaches::All, None::<fn(&mut ())>);
            let estimate = channel.estimate(stamp_ns);
            let error = flight.velocity - Vector3::from(estimate.prediction.velocity);
            let std = Vector3::from(estimate.prediction.velocity_std);
            if (2000..3000).contains(&j) && j % 50 == 0 {
                nees += error.component_div(&std).norm_squared();
                nis += agreement.unwrap().nis;
                n += 1.0;
            }
            if j >= 3000 && j % 400 == 99 {
                coasts += 3.0;
                for axis in 0..3 {
                    within += f64::from(error[axis].abs() < 1.96 * std[axis]);
                }
            }
            flight.advance(&command, 0.005);
        }
    }
    // Samples every 0.25 s are nearly independent. χ² of 3n degrees: ±1.96 √(2 · 3n).
    let (mean, spread) = (nees / (3.0 * n), 1.96 * (2.0 / (3.0 * n)).sqrt());
    let coverage = within / coasts;
    println!("NEES {mean:.3} ± {spread:.3}, NIS {:.3}, coverage of coasts {coverage:.3}", nis / n);
    assert!((mean - 1.0).abs() < spread, "NEES {mean} ± {spread}");
    assert!((0.8..1.2).contains(&(nis / n)), "NIS {}", nis / n);
    assert!((0.90..0.99).contains(&coverage), "coverage {coverage}");
}

/// RMS of the velocity error over the second half of 40 s, where every tenth sample has ten times the noise or does not come.
#[derive(Clone, Copy)]
enum Tenth {
    IsMissing,
    SaysItsNoise,
    SaysNothing,
}

fn rms_with_noisy_samples(tenth: Tenth) -> f64 {
    let (mut flight, mut channel, mut square) = (Flight::new(3), channel(), 0.0);
    for j in 0..8000_u64 {
        let command_n = flight.command_n(j as f64 * 0.005);
        let mut output = flight.measured();
        let noise = Vector3::from_fn(|_, _| 10.0 * NOISE_M_S * flight.random.normal());
        let is_noisy = j % 10 == 9;
        if is_noisy {
            output = match tenth {
                Tenth::IsMissing => [None; 3],
                _ => components(flight.velocity + noise),
            };
        }
        let says = is_noisy && matches!(tenth, Tenth::SaysItsNoise);
        let output_std = if says { [10.0 * NOISE_M_S; 3] } else { [0.0; 3] };
        let sample = JointSample { output, output_std, command: Some(command_n), ..JointSample::default() };
        channel.accept(j * PERIOD_NS, &sample, Teaches::All, None::<fn(&mut ())>);
        if j >= 4000 {
            let error = Vector3::from(channel.estimate(j * PERIOD_NS).prediction.velocity) - flight.velocity;
            square += error.norm_squared();
        }
        flight.advance(&command_n, 0.005);
    }
    (square / 4000.0).sqrt()
}

#[test]
fn a_noisy_sample_that_says_so_costs_nothing() {
    let without = rms_with_noisy_samples(Tenth::IsMissing);
    let (says, silent) = (
        rms_with_noisy_samples(Tenth::SaysItsNoise) / without,
        rms_with_noisy_samples(Tenth::SaysNothing) / without,
    );
    assert!(says < 1.05, "{says}");
    // A stray sample's influence is bounded by that of one at four deviations.
    assert!((1.2..2.3).contains(&silent), "{silent}");
}

/// A velocity of two axes, and a height: each axis knows what it was told.
#[test]
fn parts_of_readings_correct_their_own_axes() {
    let mut design = design();
    design.filter.position_noise = Some(0.1);
    let design = JointTranslationDesign {
        channel: design,
        known_force_n: Vector3::zeros(),
        gravity_m_s2: Vector3::zeros(),
    };
    let mut channel = JointChannel::translation(&design, None, None).unwrap();
    let (mut flight, mut position) = (Flight::new(8), Vector3::new(3.0, -2.0, 7.0));
    for j in 0..6000_u64 {
        let command_n = flight.command_n(j as f64 * 0.005);
        let [x, y, _] = flight.measured();
        let height = (j % 20 == 0).then(|| position.z + 0.1 * flight.random.normal());
        let sample = JointSample {
            output: [x, y, None],
            position: [None, None, height],
            command: Some(command_n),
            ..JointSample::default()
        };
        channel.accept(j * PERIOD_NS, &sample, Teaches::All, None::<fn(&mut ())>);
        let before = flight.velocity;
        flight.advance(&command_n, 0.005);
        position += 0.0025 * (before + flight.velocity);
    }
    let prediction = channel.estimate(6000 * PERIOD_NS).prediction;
    let [x, y, z] = prediction.position_std;
    assert!(z < 0.1 && (prediction.position[2] - position.z).abs() < 4.0 * z, "{prediction:?} {position}");
    // Nobody told where it is; dead reckoning of a minute's half.
    assert!(x > 0.01 && y > 0.01, "{x} {y}");
    let [vx, vy, vz] = prediction.velocity_std;
    assert!(vx == vy && vx < 0.05 && vz > vx && vz < 0.3, "{vx} {vy} {vz}");
    assert!(
        (prediction.velocity[2] - flight.velocity.z).abs() < 4.0 * vz,
        "{prediction:?} {}",
        flight.velocity
    );
}

/// Fixes of the position alone, 1 mm at 200 Hz: velocity and force are found; after a bounce that no command explains, the
/// velocity is back after ten fixes.
#[test]
fn from_positions_alone_the_velocity_is_found_and_a_bounce_is_followed() {
    const NOISE_M: f64 = 0.001;
    let mut design = design();
    design.filter.position_noise = Some(NOISE_M);
    let design = JointTranslationDesign {
        channel: design,
        known_force_n: Vector3::zeros(),
        gravity_m_s2: Vector3::zeros(),
    };
    let mut channel = JointChannel::translation(&design, None, None).unwrap();
    let (mut flight, mut position) = (Flight::new(5), Vector3::new(3.0, -2.0, 1.0));
    let (mut square, mut count, mut after_bounce) = (0.0, 0, 0.0_f64);
    for j in 0..8000_u64 {
        let t_s = j as f64 * 0.005;
        let command_n = flight.command_n(t_s);
        if j == 6000 {
            flight.velocity.z -= 2.0;
        }
        let fix = position.map(|r| Some(r + NOISE_M * flight.random.normal()));
        let sample = JointSample { position: fix.into(), command: Some(command_n), ..JointSample::default() };
        channel.accept(j * PERIOD_NS, &sample, Teaches::All, None::<fn(&mut ())>);
        let estimate = channel.estimate(j * PERIOD_NS);
        assert!(!estimate.report.coasting && (j < 10 || estimate.report.output_age_s == 0.0), "{j}");
        let error = Vector3::from(estimate.prediction.velocity) - flight.velocity;
        if (2000..6000).contains(&j) || j >= 6040 {
            square += error.norm_squared();
            count += 1;
        }
        if (6010..6040).contains(&j) {
            after_bounce = after_bounce.max(error.norm());
        }
        let before = flight.velocity;
        flight.advance(&command_n, 0.005);
        position += 0.0025 * (before + flight.velocity);
    }
    let rms_m_s = (square / f64::from(count)).sqrt();
    assert!(rms_m_s < 0.05, "{rms_m_s}");
    assert!(after_bounce < 0.2, "{after_bounce}");
}

/// A channel that is loaded from a checkpoint goes on with the same bits, shared covariances or not.
#[test]
fn a_channel_loaded_from_a_checkpoint_goes_on_with_the_same_bits() {
    for measured_axes in [3, 2] {
        let (mut channel, mut other) = (channel(), channel());
        let mut flight = Flight::new(5);
        let mut fly = |channels: &mut [&mut JointChannel<()>], samples: std::ops::Range<u64>| {
            for j in samples {
                let command = flight.command_n(j as f64 * 0.005);
                let mut output = flight.measured();
                output[measured_axes..].fill(None);
                let position = if j % 40 == 0 { [Some(0.1); 3] } else { [None; 3] };
                let sample =
                    JointSample { output, position, command: Some(command), ..JointSample::default() };
                for channel in &mut *channels {
                    channel.accept(1_000_000_000 + j * PERIOD_NS, &sample, Teaches::All, None::<fn(&mut ())>);
                }
                flight.advance(&command, 0.005);
            }
        };
        fly(&mut [&mut channel], 0..700);
        let state = channel.save();
        let mut learned = vec![f64::NAN; channel.n_learned()];
        // In parts, as a snapshot is read.
        for from in (0..learned.len()).step_by(1000) {
            let end = learned.len().min(from + 1000);
            channel.read_saved(from, &mut learned[from..end]);
        }
        other.load(&learned, Some(&state));
        assert_eq!(other.save(), state);
        fly(&mut [&mut channel, &mut other], 700..1100);
        let later_ns = 1_000_000_000 + 1120 * PERIOD_NS;
        let [a, b] = [&mut channel, &mut other].map(|channel| format!("{:?}", channel.estimate(later_ns)));
        assert_eq!(a, b);
        // Restored, it is where it was; without the state it knows the weights and doubts them a little.
        other.restore(None);
        assert!(!other.at.state.is_started());
        let doubted = other.at.state.weights_trace(0);
        channel.restore(Some(&state));
        let before = channel.at.state.weights_trace(0);
        let p = (channel.filter.n_rows() - 2) as f64;
        assert!(doubted > before && doubted < p, "{before} {doubted} {p}");
    }
}

/// The rotation of a small multicopter.
fn rotation_design(rate_noise_rad_s: f64, bias_std_rad_s: f64) -> JointRotationDesign {
    let mut filter = joint_law([0.01; 3]);
    filter.noise = [rate_noise_rad_s; 3];
    filter.prior =
        PriorDeviations { bias: 15.0, linear: 9.0, kernel: 10.5, input: 0.5, lag: 0.5, disturbance: 3.0 };
    (filter.process_noise, filter.lags_s) = (0.1, [0.05, 0.1]);
    JointRotationDesign {
        channel: JointChannelDesign { filter, inertia: Matrix3::identity() * 0.02, hold_s: 0.0075 },
        gyroscopic_torque: GyroscopicTorque::Learned,
        attitude_noise_rad: 0.03,
        bias_std_rad_s,
        bias_walk_rad_s_sqrt_s: 0.0,
    }
}

/// Coning of half-angle 5° at 20 Hz, from rates at this period, for a minute; fixes at 10 Hz or none: how far the attitude drifts
/// from the tenth second on, and its largest error since then (°). Before, the filter is tossed by 1400 rad/s² that nobody told it
/// of, and takes samples for stray ones until it has learned the motion.
fn coning_deg(period_ns: u64, has_fixes: bool) -> (f64, f64) {
    let (half_angle, turn_rad_s) = (5.0_f64.to_radians(), std::f64::consts::TAU * 20.0);
    let (sin, cos) = (0.5 * half_angle).sin_cos();
    let attitude = |t: f64| {
        let (s, c) = (turn_rad_s * t).sin_cos();
        UnitQuaternion::from_quaternion(nalgebra::Quaternion::new(cos, sin * c, sin * s, 0.0))
    };
    // ω = 2 q⁻¹ q', by components.
    let rate = |t: f64| {
        let (s, c) = (turn_rad_s * t).sin_cos();
        2.0 * turn_rad_s * sin * Vector3::new(-cos * s, cos * c, -sin)
    };
    let mut channel = JointChannel::rotation(&rotation_design(0.01, 0.0), None, Some(attitude(0.0))).unwrap();
    let (mut start, mut drift, mut largest) = (None, 0.0, 0.0_f64);
    for j in 0..60_000_000_000 / period_ns {
        let (stamp_ns, t) = (1_000_000_000 + j * period_ns, j as f64 * period_ns as f64 * 1e-9);
        let sample = JointSample { output: components(rate(t)), ..JointSample::default() };
        let fix = attitude(t);
        let take_fix = |pose: &mut AttitudeFilter| pose.take_fix(&fix, &[0.01; 3]);
        let has_fix = has_fixes && (j * period_ns).is_multiple_of(100_000_000);
        channel.accept(stamp_ns, &sample, Teaches::All, has_fix.then_some(take_fix));
        if t > 10.0 {
            let error = channel.attitude().attitude * attitude(t).inverse();
            let start = *start.get_or_insert(error);
            drift = error.angle_to(&start).to_degrees();
            largest = largest.max(error.angle().to_degrees());
        }
    }
    (drift, largest)
}

#[test]
fn coning_drifts_little() {
    let (drift, _) = coning_deg(1_000_000, false);
    assert!(drift < 0.3, "1 kHz: {drift}° in a minute");
    // A rate at 200 Hz says little of 20 Hz: 106° by the mean of two rates.
    let (drift, _) = coning_deg(5_000_000, false);
    assert!(drift < 25.0, "200 Hz: {drift}° in a minute");
    let (_, largest) = coning_deg(5_000_000, true);
    assert!(largest < 0.4, "200 Hz with fixes: {largest}°");
}

/// Rates of a noisy gyroscope with a bias, attitude fixes at 10 Hz, outages of the rates: the attitude's errors are as large
/// as its deviations say, and the bias is found.
#[test]
fn the_attitude_s_deviations_are_honest() {
    let (rate_noise, fix_noise, h) = (0.02, 0.03, 0.005);
    let design = rotation_design(rate_noise, 0.05);
    let (mut nees, mut before_fix, mut coast, mut n, mut n_coast) = (0.0, 0.0, 0.0, 0.0, 0.0);
    let (mut bias_error, mut bias_std) = (0.0, 0.0);
    for seed in 1..=20 {
        let mut random = Random(seed);
        let mut channel = JointChannel::rotation(&design, None, None).unwrap();
        let bias = Vector3::from_fn(|_, _| 0.05 * random.normal());
        let (mut rate, mut attitude) = (Vector3::<f64>::zeros(), UnitQuaternion::identity());
        let mut gust = Vector3::<f64>::zeros();
        for j in 0..6000_u64 {
            let (stamp_ns, t) = (1_000_000_000 + j * PERIOD_NS, j as f64 * h);
            let torque = 0.02 * Vector3::new(2.0 * (3.0 * t).cos(), -(2.0 * t).sin(), 0.7 * t.cos());
            let is_outage = j > 2000 && j % 500 < 60;
            let noise = Vector3::from_fn(|_, _| rate_noise * random.normal());
            let output = if is_outage { [None; 3] } else { components(rate + bias + noise) };
            let sample = JointSample { output, command: Some(torque), ..JointSample::default() };
            let error = Vector3::from_fn(|_, _| fix_noise * random.normal());
            let fix = attitude * UnitQuaternion::new(error);
            let has_fix = j % 20 == 0 && !is_outage;
            let error_of = |channel: &mut JointChannel<AttitudeFilter>| {
                let pose = channel.estimate(stamp_ns).pose;
                let error = (pose.attitude.inverse() * attitude).scaled_axis();
                (0..3).map(|axis| (error[axis] / pose.std_rad()[axis]).powi(2)).sum::<f64>() / 3.0
            };
            if j > 2000 && j % 500 == 59 {
                (coast, n_coast) = (coast + error_of(&mut channel), n_coast + 1.0);
            }
            let is_counted = j > 1000 && !(j > 2000 && j % 500 < 200) && has_fix && j % 100 == 0;
            if is_counted {
                before_fix += error_of(&mut channel);
            }
            let take_fix = |pose: &mut AttitudeFilter| pose.take_fix(&fix, &[fix_noise; 3]);
            channel.accept(stamp_ns, &sample, Teaches::All, has_fix.then_some(take_fix));
            if is_counted {
                (nees, n) = (nees + error_of(&mut channel), n + 1.0);
            }
            // The disturbance and the noise that the filter is told of.
            let decay = (-h / 0.2_f64).exp();
            gust =
                decay * gust + Vector3::from_fn(|_, _| 3.0 * (1.0 - decay * decay).sqrt() * random.normal());
            let white = Vector3::from_fn(|_, _| (0.1 * h).sqrt() * random.normal());
            let after = rate + h * (torque / 0.02 - 0.5 * rate + gust) + white;
            attitude *= UnitQuaternion::new(0.5 * h * (rate + after));
            rate = after;
        }
        let found = channel.attitude();
        bias_error += (found.bias_rad_s - bias).norm_squared() / 60.0;
        bias_std += found.bias_std_rad_s().map(|std| std * std).iter().sum::<f64>() / 60.0;
    }
    println!(
        "NEES before fixes {:.2}, after {:.2}, at the end of coasts {:.2}, bias {:.2}",
        before_fix / n,
        nees / n,
        coast / n_coast,
        bias_error / bias_std
    );
    // Fixes 0.1 s apart share errors. χ² of 3n/5 degrees, at least.
    let spread = 1.96 * (2.0 / (3.0 * n / 5.0)).sqrt();
    for value in [before_fix / n, nees / n] {
        assert!((value - 1.0).abs() < spread, "{value} ± {spread}");
    }
    assert!((0.5..1.5).contains(&(coast / n_coast)), "{}", coast / n_coast);
    assert!((0.6..1.5).contains(&(bias_error / bias_std)), "{}", bias_error / bias_std);
}

fn components(vector: Vector3<f64>) -> [Option<f64>; 3] {
    [vector.x, vector.y, vector.z].map(Some)
}
