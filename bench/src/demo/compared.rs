//! The Kalman filter that the service is compared with: position, velocity and a random-walk force, on the same samples, at
//! the same instants. It is given the preset's mass, gravity and noise, and the best of 17 densities of its force, chosen for each
//! quantity by its error against the truth.

use super::errors::{Quantity, RmsMax, Run, quaternion};
use crate::disturbance_filter::DisturbanceFilter;
use crate::kalman::densities_n2_s;
use daemon::config::ConfigFile;
use daemon::gate::Gate;
use shared_types::payload::Estimate;

/// The filter's estimates with every density; none where the configuration has no translation.
pub(super) fn tunings(run: &Run, config: &ConfigFile) -> anyhow::Result<Vec<Vec<Estimate>>> {
    let Some(translation) = &config.config.translation else { return Ok(Vec::new()) };
    let start_m = config.config.initial.position_m.unwrap_or_default().into();
    densities_n2_s(translation.mass_kg)
        .into_iter()
        .map(|density| {
            let mut filter = DisturbanceFilter::new(translation, density, None)?;
            filter.start_at_position(&start_m);
            Ok(estimates(run, config, filter))
        })
        .collect()
}

/// The tuning with the least error of a quantity over the second half.
pub(super) fn best<'a>(
    run: &Run,
    tunings: &'a [Vec<Estimate>],
    quantity: Quantity,
) -> Option<&'a [Estimate]> {
    let rms = |estimates: &[Estimate]| {
        RmsMax::over_second_half(run, estimates, quantity).map_or(f64::INFINITY, |error| error.rms)
    };
    tunings.iter().map(Vec::as_slice).min_by(|a, b| rms(a).total_cmp(&rms(b)))
}

fn estimates(run: &Run, config: &ConfigFile, mut filter: DisturbanceFilter) -> Vec<Estimate> {
    let mut gate = Gate::new(config.config.input, true);
    let mut samples = run.measurements().iter().peekable();
    let estimate = |estimate: &Estimate| {
        // The service's own attitude: what is compared is the translation.
        let attitude = quaternion(estimate.attitude_wxyz);
        while let Some(sample) = samples.next_if(|sample| sample.sequence <= estimate.source_sequence) {
            if let Ok(accepted) = gate.judge(sample, 0, &gate.in_order(sample, estimate.stamp_ns)) {
                filter.take(&accepted.sample, &attitude);
            }
        }
        let mut now = filter.clone();
        now.predict(estimate.stamp_ns);
        Estimate {
            position_m: now.position_m().into(),
            velocity_m_s: now.velocity_m_s().into(),
            matched_force_n: now.force_n().into(),
            ..*estimate
        }
    };
    run.estimates.iter().map(estimate).collect()
}
