//! Checks of bounds and combinations of keys. They need neither the observer nor the machine.

use crate::file::{ConfigError, ConfigFile};
use crate::reference;
use crate::schema::{SCHEMA, properties, table};
use crate::sensors::SensorClock;
use crate::service::{Clock, Trigger};
use crate::values::LawName;
use serde_json::Value;

/// Priority 99 is that of the kernel's own watchdog and migration threads.
const MAX_PRIORITY: u8 = 98;
/// A loop with a fixed priority that polls for more than this part of the only core starves everything else.
const MAX_SHARE_OF_THE_ONLY_CORE: f64 = 0.5;
/// The tables whose values the observers check; of each, `sample_rate_hz` is checked here.
const CHANNELS: [&str; 3] = ["translation", "rotation", "linear"];

impl ConfigFile {
    /// Checks every key but those that are checked when the observers are built.
    ///
    /// # Errors
    /// The key, its line, what was found and what would be accepted.
    pub fn check(&self) -> Result<(), ConfigError> {
        let config = &self.config;
        self.check_real_time()?;
        self.check_laws()?;
        let values = serde_json::to_value(config).expect("a configuration is a JSON document");
        for (name, schema) in properties(&SCHEMA) {
            let Some(value) = values.get(name) else { continue };
            if table(schema).is_none() {
                self.check_bounds(name, schema, value)?;
            }
            let tables = match value.as_array().filter(|_| table(schema).is_some()) {
                None => vec![(name.to_owned(), value)],
                Some(tables) => {
                    tables.iter().enumerate().map(|(i, value)| (format!("{name}.{i}"), value)).collect()
                }
            };
            for (path, value) in tables {
                for (key, schema) in properties(schema) {
                    if let Some(value) = value.get(key)
                        && (!CHANNELS.contains(&name) || key == "sample_rate_hz")
                    {
                        self.check_bounds(&format!("{path}.{key}"), schema, value)?;
                    }
                }
            }
        }
        self.check_sensors()?;
        if config.spin_us > 1e6 / config.rate_hz {
            let needed = format!("0 … {:.0}, the period of rate_hz (in µs)", 1e6 / config.rate_hz);
            return Err(self.refusal("spin_us", &config.spin_us.to_string(), &needed));
        }
        Ok(())
    }

    /// Each number and name once; a mounting is a rotation; a lever arm needs the angular velocity.
    fn check_sensors(&self) -> Result<(), ConfigError> {
        let sensors = &self.config.sensor;
        for (i, sensor) in sensors.iter().enumerate() {
            let refuse = |key: &str, found: String, needed: &str| {
                Err(self.refusal(&format!("sensor.{i}.{key}"), &found, needed))
            };
            if sensors[..i].iter().any(|other| other.number == sensor.number) {
                return refuse("number", sensor.number.to_string(), "a number that no other sensor has");
            }
            if sensor.name.is_empty() || sensors[..i].iter().any(|other| other.name == sensor.name) {
                return refuse("name", format!("\"{}\"", sensor.name), "a name that no other sensor has");
            }
            let norm = sensor.mounting_wxyz.iter().map(|x| x * x).sum::<f64>().sqrt();
            if (norm - 1.0).abs().is_nan() || (norm - 1.0).abs() > 1e-3 {
                let needed = "a unit quaternion w, x, y, z";
                return refuse(
                    "mounting_wxyz",
                    format!("{:?}, of norm {norm}", sensor.mounting_wxyz),
                    needed,
                );
            }
            if sensor.latency_s >= self.config.input.max_age_s {
                let needed = format!(
                    "less than input.max_age_s, {} s: its samples would all be too old",
                    self.config.input.max_age_s
                );
                return refuse("latency_s", sensor.latency_s.to_string(), &needed);
            }
            let has_accelerometer =
                self.config.translation.as_ref().is_some_and(|t| t.joint.specific_force_noise_m_s2 > 0.0);
            if sensor.specific_force_noise_m_s2 > 0.0 && !has_accelerometer {
                let needed = "translation.joint.specific_force_noise_m_s2 above 0, without which no specific force is used; or 0";
                return refuse(
                    "specific_force_noise_m_s2",
                    sensor.specific_force_noise_m_s2.to_string(),
                    needed,
                );
            }
            if sensor.clock != SensorClock::Monotonic && self.config.clock != Clock::Monotonic {
                let needed = "\"monotonic\" where clock = \"samples\": the stamps themselves are the time";
                return refuse("clock", format!("{:?}", sensor.clock).to_lowercase(), needed);
            }
            if !sensor.lever_arm_m.iter().all(|x| x.abs() < 1e6) {
                return refuse("lever_arm_m", format!("{:?}", sensor.lever_arm_m), "finite numbers");
            }
            if sensor.lever_arm_m != [0.0; 3] && self.config.rotation.is_none() {
                let needed = "[rotation]: a lever arm counts only with the attitude, or zeros";
                return refuse("lever_arm_m", format!("{:?}", sensor.lever_arm_m), needed);
            }
        }
        Ok(())
    }

    /// The keys of a channel are those of its law.
    fn check_laws(&self) -> Result<(), ConfigError> {
        let foreign = self.config.keys_of_other_laws();
        if let Some(key) = foreign.iter().find(|key| self.is_given(key)) {
            let law_key = format!("{}.law", key.split('.').next().unwrap_or(key));
            let (law, other) = if self
                .config
                .laws()
                .any(|(table, law, _)| key.starts_with(&format!("{table}.")) && law == LawName::Joint)
            {
                (LawName::Joint, LawName::Gradient)
            } else {
                (LawName::Gradient, LawName::Joint)
            };
            let default = if self.is_given(&law_key) { "" } else { " (the default)" };
            let found = format!("it with {law_key} = \"{}\"{default}", law.name());
            let needed = format!("{law_key} = \"{}\", or no such key", other.name());
            return Err(self.refusal(key, &found, &needed));
        }
        let values = serde_json::to_value(&self.config).expect("a configuration is a JSON document");
        for (table, law, [joint, gradient]) in self.config.laws() {
            let own = if law == LawName::Joint { joint } else { gradient };
            if let Some(key) = own.required.iter().find(|key| values[table].get(key).is_none()) {
                return Err(self.missing(table, key, law));
            }
        }
        Ok(())
    }

    /// Compares a value with its key's bounds in the schema. JSON has no NaN and no infinity: they are null.
    fn check_bounds(&self, key: &str, schema: &Value, value: &Value) -> Result<(), ConfigError> {
        let holds = |bound: &str, test: fn(f64, f64) -> bool| {
            schema[bound].as_f64().is_none_or(|bound| value.as_f64().is_some_and(|value| test(value, bound)))
        };
        if holds("minimum", |x, low| x >= low)
            && holds("maximum", |x, high| x <= high)
            && holds("exclusiveMinimum", |x, low| x > low)
        {
            return Ok(());
        }
        let found = if value.is_null() { "no finite number".into() } else { value.to_string() };
        Err(self.refusal(key, &found, &reference::bounds_in_words(key, schema)))
    }

    /// What needs no look at the machine.
    fn check_real_time(&self) -> Result<(), ConfigError> {
        let real_time = &self.config.real_time;
        if let Some(priority) = real_time.priority.filter(|p| !(1..=MAX_PRIORITY).contains(p)) {
            let needed = format!("1 … {MAX_PRIORITY} (99 is the kernel's own), or no such key");
            return Err(self.refusal("real_time.priority", &priority.to_string(), &needed));
        }
        let Some(cores) = &real_time.cores else { return Ok(()) };
        let mut sorted = cores.clone();
        sorted.sort_unstable();
        sorted.dedup();
        if sorted.len() != cores.len() || cores.is_empty() {
            let needed = "at least one core, each once, as [2] or [2, 3]; or no such key";
            return Err(self.refusal("real_time.cores", &format!("{cores:?}"), needed));
        }
        Ok(())
    }

    /// What the cores decide that this process may use: those asked for must be among them, and a loop that
    /// polls at a fixed priority must not have the only one.
    ///
    /// # Errors
    /// The key, its line, what was found and what would be accepted.
    pub fn check_cores(&self, allowed: &[usize]) -> Result<(), ConfigError> {
        let config = &self.config;
        let real_time = &config.real_time;
        let not_allowed =
            |cores: &&Vec<usize>| !allowed.is_empty() && cores.iter().any(|core| !allowed.contains(core));
        if let Some(cores) = real_time.cores.as_ref().filter(not_allowed) {
            let needed = format!(
                "some of {allowed:?}, which this process may use (taskset -cp PID; AllowedCPUs= of systemd, --cpuset-cpus of a container)"
            );
            return Err(self.refusal("real_time.cores", &format!("{cores:?}"), &needed));
        }
        if real_time.priority.is_none() || allowed.len() != 1 {
            return Ok(());
        }
        let (key, found) = if config.trigger == Trigger::Sample {
            ("trigger", "\"sample\"".to_owned())
        } else if config.spin_us * 1e-6 * config.rate_hz > MAX_SHARE_OF_THE_ONLY_CORE {
            ("spin_us", config.spin_us.to_string())
        } else {
            return Ok(());
        };
        let needed = "a second core, trigger = \"timer\" with spin_us below half a period, or no real_time.priority: \
                      polling at a fixed priority on the only core starves every other thread, and the kernel then stops \
                      the loop for 50 ms of every second (sched_rt_runtime_us)";
        Err(self.refusal(key, &found, needed))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::presets::PRESETS;

    fn file(before: &str, table: &str) -> ConfigFile {
        // Lines before and after the preset's own, which are whole ones.
        let text = format!("{before}\n{}\n[real_time]\n{table}\n", PRESETS[0].1);
        ConfigFile::parse("vehicle.toml".into(), text).unwrap()
    }

    #[test]
    fn dangerous_settings_are_refused_with_their_line_and_reason() {
        for (table, parts) in [
            ("priority = 99", ["real_time.priority", "found 99", "1 … 98"]),
            ("priority = 0", ["real_time.priority", "found 0", "1 … 98"]),
            ("cores = []", ["real_time.cores", "found []", "at least one core"]),
            ("cores = [1, 1]", ["real_time.cores", "found [1, 1]", "each once"]),
        ] {
            let error = file("", table).check().unwrap_err().to_string();
            let line = format!("vehicle.toml, line {}", PRESETS[0].1.lines().count() + 4);
            assert!(parts.iter().all(|part| error.contains(part)) && error.contains(&line), "{error}");
        }
        let text = format!("{}\n[real_time]\npriority = -1\n", PRESETS[0].1);
        assert!(ConfigFile::parse("vehicle.toml".into(), text).is_err());
    }

    #[test]
    fn a_sensor_that_cannot_be_meant_is_refused_with_its_line() {
        let preset = PRESETS.iter().find(|(name, _)| *name == "rigid-body").unwrap().1;
        let check = |sensors: &str| {
            let file = ConfigFile::parse("vehicle.toml".into(), format!("{preset}\n{sensors}")).unwrap();
            file.check().map_err(|error| error.to_string())
        };
        let first = "[[sensor]]\nname = \"imu\"\nnumber = 1\n";
        check(&format!("{first}[[sensor]]\nname = \"dvl\"\nnumber = 2\nlatency_s = 0.4")).unwrap();
        let line = preset.lines().count() + 7;
        for (second, parts) in [
            ("name = \"dvl\"\nnumber = 1", ["sensor.1.number", "no other sensor"]),
            ("name = \"dvl\"\nnumber = 16", ["sensor.1.number", "1 … 15"]),
            ("name = \"dvl\"\nlatency_s = 0.5\nnumber = 2", ["sensor.1.latency_s", "input.max_age_s"]),
            (
                "name = \"dvl\"\nmounting_wxyz = [1, 1, 0, 0]\nnumber = 2",
                ["mounting_wxyz", "unit quaternion"],
            ),
            (
                "name = \"dvl\"\nspecific_force_noise_m_s2 = 1\nnumber = 2",
                ["specific_force", "translation.joint"],
            ),
        ] {
            let error = check(&format!("{first}[[sensor]]\n{second}")).unwrap_err();
            assert!(parts.iter().all(|part| error.contains(part)), "{error}");
            assert!(error.contains(&format!("line {line}")), "{line}: {error}");
        }
        let text = format!("clock = \"samples\"\n{preset}\n{first}clock = \"own\"");
        let error = ConfigFile::parse("vehicle.toml".into(), text).unwrap().check().unwrap_err().to_string();
        assert!(error.contains("sensor.0.clock") && error.contains("found own"), "{error}");
    }

    #[test]
    fn cores_must_be_among_those_allowed_and_polling_must_leave_one() {
        let fine = file("", "cores = [1]\npriority = 80");
        fine.check_cores(&[0, 1]).unwrap();
        let error = fine.check_cores(&[0, 2]).unwrap_err().to_string();
        assert!(error.contains("found [1]") && error.contains("[0, 2]"), "{error}");
        // Unknown cores: the system is asked, and answers.
        fine.check_cores(&[]).unwrap();

        let polling = |before: &str| file(before, "priority = 80").check_cores(&[0]);
        let error = polling("trigger = \"sample\"").unwrap_err().to_string();
        assert!(error.contains("line 1") && error.contains("starves"), "{error}");
        // rate_hz of the preset is 200: half a period is 2500 µs.
        polling("spin_us = 2600.0").unwrap_err();
        polling("spin_us = 200.0").unwrap();
        file("trigger = \"sample\"", "priority = 80").check_cores(&[0, 1]).unwrap();
        file("trigger = \"sample\"", "").check_cores(&[0]).unwrap();
    }
}
