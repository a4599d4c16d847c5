//! True plants and their pilots; they share nothing with the filter's model.

use crate::random::Random;
use nalgebra::Vector3;

/// Steps of the true plant are no longer than this (s).
const MAX_STEP_S: f64 = 0.0025;

/// A body of constant mass in a wind, with quadratic drag, a load, and gusts.
///
/// `m v' = u + m g + f,   f = load − k |v − wind| (v − wind) + m d + (ū − u),   ū' = (u − ū)/τ,   v also walks randomly`
#[derive(Debug, Clone)]
pub(crate) struct Vehicle {
    pub(crate) mass_kg: f64,
    pub(crate) gravity_m_s2: Vector3<f64>,
    /// k (N s²/m²).
    pub(crate) drag: f64,
    pub(crate) wind_m_s: Vector3<f64>,
    pub(crate) load_n: Vector3<f64>,
    /// τ of the actuators (s); 0: they follow at once.
    pub(crate) actuators_s: f64,
    /// ū (N).
    pub(crate) actual_n: Vector3<f64>,
    /// Deviation (m/s²) and time (s) of the gusts d.
    pub(crate) gust: (f64, f64),
    /// Density of the white acceleration noise ((m/s²)² s).
    pub(crate) white_noise: f64,
    pub(crate) position_m: Vector3<f64>,
    pub(crate) velocity_m_s: Vector3<f64>,
    pub(crate) gust_m_s2: Vector3<f64>,
    pub(crate) random: Random,
}

impl Vehicle {
    /// f without gust and actuators (N).
    fn force_n(&self, velocity: &Vector3<f64>) -> Vector3<f64> {
        let air = velocity - self.wind_m_s;
        self.load_n - self.drag * air.norm() * air
    }

    /// Moves by `h_s` with the command held, RK4; the mean of f over the step (N).
    pub(crate) fn advance(&mut self, command_n: &Vector3<f64>, h_s: f64) -> Vector3<f64> {
        let n = (h_s / MAX_STEP_S - 1e-9).ceil();
        let dt = h_s / n;
        let decay = (-dt / self.gust.1).exp();
        let gust_std = self.gust.0 * (1.0 - decay * decay).sqrt();
        let white_std = (self.white_noise * dt).sqrt();
        let mut impulse = Vector3::zeros();
        for _ in 0..n as usize {
            // The mean of the actual force over the short step.
            let follows = if self.actuators_s > 0.0 { (-dt / self.actuators_s).exp() } else { 0.0 };
            let mean = if self.actuators_s > 0.0 { self.actuators_s * (1.0 - follows) / dt } else { 0.0 };
            let behind_n = self.actual_n - command_n;
            self.actual_n = command_n + follows * behind_n;
            let gust_n = self.mass_kg * self.gust_m_s2 + mean * behind_n;
            let known = command_n / self.mass_kg + self.gravity_m_s2;
            let v = self.velocity_m_s;
            let acceleration = |f: &Vector3<f64>| known + f / self.mass_kg;
            let f1 = self.force_n(&v) + gust_n;
            let v2 = v + 0.5 * dt * acceleration(&f1);
            let f2 = self.force_n(&v2) + gust_n;
            let v3 = v + 0.5 * dt * acceleration(&f2);
            let f3 = self.force_n(&v3) + gust_n;
            let v4 = v + dt * acceleration(&f3);
            let f4 = self.force_n(&v4) + gust_n;
            let f = (f1 + 2.0 * f2 + 2.0 * f3 + f4) / 6.0;
            impulse += dt * f;
            self.position_m += dt / 6.0 * (v + 2.0 * v2 + 2.0 * v3 + v4);
            self.velocity_m_s = v + dt * acceleration(&f) + white_std * self.random.normals();
            self.gust_m_s2 = decay * self.gust_m_s2 + gust_std * self.random.normals();
        }
        impulse / h_s
    }
}

/// Follows a reference of the velocity and its integral, by feedback on position and velocity.
#[derive(Debug, Clone)]
pub(crate) struct Pilot {
    /// Gains of position (1/s²), velocity (1/s) and of the position error's integral (1/s³).
    pub(crate) gains: (f64, f64, f64),
    /// The reference follows what is wanted with this time (s).
    pub(crate) reference_s: f64,
    /// Largest acceleration of each axis (m/s²).
    pub(crate) max_m_s2: f64,
    pub(crate) reference_m: Vector3<f64>,
    pub(crate) reference_m_s: Vector3<f64>,
    pub(crate) integral_m_s: Vector3<f64>,
}

impl Pilot {
    /// The command for the next `h_s` (N), from the true position and a velocity.
    pub(crate) fn command_n(
        &mut self,
        vehicle: &Vehicle,
        velocity_m_s: &Vector3<f64>,
        wanted_m_s: &Vector3<f64>,
        h_s: f64,
    ) -> Vector3<f64> {
        let (position, rate, integral) = self.gains;
        let reference_m_s2 = (wanted_m_s - self.reference_m_s) / self.reference_s;
        let error_m = (self.reference_m - vehicle.position_m).map(|e| e.clamp(-1.0, 1.0));
        let error_m_s = self.reference_m_s - velocity_m_s;
        let wanted = reference_m_s2 + position * error_m + rate * error_m_s + integral * self.integral_m_s;
        let command = wanted.map(|a| a.clamp(-self.max_m_s2, self.max_m_s2)) - vehicle.gravity_m_s2;
        self.integral_m_s = (self.integral_m_s + h_s * error_m).map(|i| i.clamp(-3.0, 3.0));
        self.reference_m_s += h_s * reference_m_s2;
        // A reference that runs away from a saturated vehicle waits for it.
        self.reference_m = vehicle.position_m + error_m + h_s * self.reference_m_s;
        vehicle.mass_kg * command
    }
}
