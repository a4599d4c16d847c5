//! What `daemon check` says of each `[[sensor]]`.

use crate::config::{ConfigFile, SensorConfig};
use serde_json::{Value, json};

/// The sensor's part of the document of `--json`.
pub(super) fn document(file: &ConfigFile, sensor: &SensorConfig) -> Value {
    json!({
        "name": sensor.name,
        "number": sensor.number,
        "samples_fused_again": fused_again(file, sensor),
        "largest_velocity_of_lever_arm_m_s": largest_of_lever_arm_m_s(file, sensor),
    })
}

/// How many samples at `rate_hz` are fused again for each of this sensor's, whose latency is configured.
fn fused_again(file: &ConfigFile, sensor: &SensorConfig) -> u64 {
    (sensor.latency_s * file.config.rate_hz).floor() as u64
}

/// The velocity of the sensor's place against the center of mass at the edge of the box of rates (m/s).
fn largest_of_lever_arm_m_s(file: &ConfigFile, sensor: &SensorConfig) -> Option<f64> {
    let rates: [f64; 3] = file.config.rotation.as_ref()?.rate_box_rad_s?.into();
    let largest = rates.into_iter().fold(0.0, f64::max);
    Some(largest * sensor.lever_arm_m.iter().map(|x| x * x).sum::<f64>().sqrt())
}

/// What a sensor's place and latency mean for the estimate.
pub(super) fn in_words(file: &ConfigFile, sensor: &SensorConfig) -> String {
    let mut facts = Vec::new();
    let arm_m = sensor.lever_arm_m.iter().map(|x| x * x).sum::<f64>().sqrt();
    if arm_m > 0.0 {
        let most = largest_of_lever_arm_m_s(file, sensor);
        let most = most.map_or(String::new(), |most| {
            format!(", which moves by up to {most:.3} m/s against it at the edge of rotation.rate_box_rad_s")
        });
        facts.push(format!(
            "{arm_m:.3} m from the center of mass{most}: velocity and position need the attitude and wait for it"
        ));
    }
    if sensor.mounting_wxyz != [1.0, 0.0, 0.0, 0.0] {
        let degrees = 2.0 * sensor.mounting_wxyz[0].abs().min(1.0).acos().to_degrees();
        facts.push(format!("turned by {degrees:.1}°"));
    }
    if sensor.latency_s > 0.0 {
        facts.push(format!(
            "{} s late: {} samples at rate_hz are fused again for each of its own",
            sensor.latency_s,
            fused_again(file, sensor)
        ));
    }
    let noises = [
        ("velocity", "m/s", sensor.velocity_noise_m_s),
        ("angular velocity", "rad/s", sensor.angular_velocity_noise_rad_s),
        ("specific force", "m/s²", sensor.specific_force_noise_m_s2),
        ("position", "m", sensor.position_noise_m),
        ("attitude", "rad", sensor.attitude_noise_rad),
    ];
    for (name, unit, noise) in noises.into_iter().filter(|(.., noise)| *noise > 0.0) {
        facts.push(format!("{name} ± {noise} {unit}"));
    }
    let facts = if facts.is_empty() { "as the channels have it".into() } else { facts.join("; ") };
    format!("sensor {} (number {}): {facts}", sensor.name, sensor.number)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::PRESETS;

    #[test]
    fn a_sensor_s_place_latency_and_noise_are_told() {
        let preset = PRESETS.iter().find(|(name, _)| *name == "auv").unwrap().1;
        let sensor = "[[sensor]]\nname = \"dvl\"\nnumber = 1\nlever_arm_m = [0.6, 0, 0.8]\nlatency_s = 0.15\n\
                      mounting_wxyz = [0, 0, 0, 1]\nvelocity_noise_m_s = 0.02";
        let file = ConfigFile::parse("auv.toml".into(), format!("{preset}\n{sensor}")).unwrap();
        file.check().unwrap();
        let words = in_words(&file, &file.config.sensor[0]);
        for part in [
            "sensor dvl (number 1): 1.000 m from the center of mass",
            "up to 0.500 m/s",
            "turned by 180.0°",
            "0.15 s late: 15 samples",
            "velocity ± 0.02 m/s",
        ] {
            assert!(words.contains(part), "{words}");
        }
        assert_eq!(document(&file, &file.config.sensor[0])["samples_fused_again"], 15);
    }
}
