//! Inspects a log: its contents, and the options and configuration values that follow from it.

use crate::csv::Csv;
use crate::error::{ImportError, Imported};
use crate::importer::{ImportOption, ImportOptions, Importer};
use crate::list::{by_ending, check, read_file};
use crate::record::Record;
use crate::table::CsvMap;
use serde::Serialize;
use shared_types::Measurement;
use shared_types::payload::{frame, valid};
use shared_types::table::Field;
use std::fmt;
use std::path::Path;

/// One measured quantity of a log.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Quantity {
    /// Which, with its unit.
    pub name: String,
    /// Samples that carry it.
    pub samples: usize,
    /// One over the median time between two of them; `None` for fewer than two (Hz).
    pub rate_hz: Option<f64>,
    /// Longest time between two of them (s).
    pub longest_gap_s: f64,
    /// Least value of each component.
    pub lowest: Vec<f64>,
    /// Greatest value of each component.
    pub highest: Vec<f64>,
    /// White noise of each component of a measured quantity, 1 σ: what third differences leave of a smooth motion. Of a smoothed
    /// log it is less than the sensor's. Empty where it cannot be told.
    pub noise: Vec<f64>,
}

/// What a log holds.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Findings {
    /// Which file.
    pub file: String,
    /// How it is written.
    pub format: String,
    /// Samples that can be published; 0 where the table's columns are not named yet.
    pub samples: usize,
    /// From the first to the last one (s).
    pub duration_s: f64,
    /// The time in the air, if the format marks it (s).
    pub airborne_s: Option<(f64, f64)>,
    /// What is measured.
    pub quantities: Vec<Quantity>,
    /// Rows and values that cannot be used, and what the file lacks.
    pub remarks: Vec<String>,
    /// Topics of the log, with the number of their messages; columns of a table.
    pub contents: Vec<String>,
    /// Commands for the next step.
    pub commands: Vec<String>,
    /// Lines of a configuration that follow from the log's rates.
    pub configuration: Vec<String>,
}

/// Inspects a log.
///
/// # Errors
/// As [`crate::read_flight`]; a table whose columns are not named is no error.
pub fn inspect(importer: &dyn Importer, path: &Path, options: &ImportOptions) -> Imported<Findings> {
    let file = path.display().to_string();
    check(importer, options)?;
    let bytes = read_file(path)?;
    let contents = importer.contents(&bytes, &file, options)?;
    let flight = match importer.import(&bytes, &file, options) {
        Err(ImportError::Map(error)) if importer.format().name == Csv.format().name => {
            return Ok(unnamed_columns(file, &error.to_string(), contents, &options.columns));
        }
        other => other?,
    };
    let lacks_thrust = importer.format().reads.contains(&ImportOption::Scales)
        && options.thrust_n.or(options.mass_kg).is_none();
    let quantities = quantities(&flight.samples);
    let arguments = arguments(importer, path, options, lacks_thrust);
    let airborne = if flight.airborne.is_some() { " --airborne-only" } else { "" };
    let has = |bit: u32| flight.samples.iter().any(|sample| sample.has(bit));
    let shown = shell_word(&file);
    let mut commands = vec![format!("sim_publisher replay {shown}{arguments}{airborne}")];
    if has(valid::VELOCITY) && (has(valid::FORCE) || lacks_thrust) {
        // A flight record has its own.
        let config =
            if importer.format().name == Record.format().name { "" } else { " --config vehicle.toml" };
        commands.push(format!("bench replay {shown}{arguments}{config}"));
        commands.push(format!("bench tune {shown}{arguments}{config}"));
    }
    Ok(Findings {
        format: importer.format().name.into(),
        samples: flight.samples.len(),
        duration_s: flight.duration_s(),
        airborne_s: flight.airborne_s(),
        configuration: configuration(&quantities),
        quantities,
        remarks: flight.findings(),
        contents,
        commands,
        file,
    })
}

/// Of a table whose columns are not named yet: what they may be.
fn unnamed_columns(file: String, error: &str, columns: Vec<String>, map: &CsvMap) -> Findings {
    let mut remarks = vec![error.to_owned()];
    let given = map.pairs();
    let mut pairs = given.clone();
    let separator = match &columns[..] {
        [only] => [';', '\t', ' ', '|'].into_iter().find(|&separator| only.contains(separator)),
        _ => None,
    };
    if let Some(separator) = separator {
        remarks.push("a single column; the command below tries another separator".into());
        pairs.push(format!("separator={separator}"));
    } else {
        let is_given = |key: &String| given.iter().any(|pair| pair.split('=').next() == Some(key));
        let guesses = guesses(&columns).into_iter().filter(|(key, _)| !is_given(key));
        pairs.extend(guesses.map(|(key, column)| format!("{key}={column}")));
        if pairs.len() > given.len() {
            remarks.push(
                "the columns below are guessed from their names: check them, their units (SI) and axes"
                    .into(),
            );
        }
    }
    let command = match pairs.len() > given.len() {
        true => {
            let format = format_argument(&Csv, Path::new(&file));
            format!("sim_publisher inspect {}{format}{}", shell_word(&file), column_arguments(&pairs))
        }
        false => {
            "sim_publisher inspect FILE --column KEY=COLUMN … (keys: sim_publisher replay --help)".into()
        }
    };
    Findings {
        file,
        format: Csv.format().name.into(),
        samples: 0,
        duration_s: 0.0,
        airborne_s: None,
        quantities: Vec::new(),
        remarks,
        contents: columns,
        commands: vec![command],
        configuration: Vec::new(),
    }
}

/// The option `--format`, if the file's ending does not determine the format.
fn format_argument(importer: &dyn Importer, file: &Path) -> String {
    let is_told = by_ending(file).is_some_and(|told| told.format().name == importer.format().name);
    if is_told { String::new() } else { format!(" --format {}", importer.format().name) }
}

fn column_arguments(pairs: &[String]) -> String {
    pairs.iter().map(|pair| format!(" --column {}", shell_word(pair))).collect()
}

/// The options that were given, and the mass where it is still needed.
fn arguments(importer: &dyn Importer, file: &Path, options: &ImportOptions, lacks_thrust: bool) -> String {
    let mut arguments = format_argument(importer, file) + &column_arguments(&options.columns.pairs());
    if let Some(topic) = &options.topic {
        arguments += &format!(" --topic {}", shell_word(topic));
    }
    for (option, value) in [("--thrust-n", options.thrust_n), ("--mass-kg", options.mass_kg)] {
        arguments += &value.map_or(String::new(), |value| format!(" {option} {value}"));
    }
    if let Some([x, y, z]) = options.torque_n_m {
        arguments += &format!(" --torque-n-m {x},{y},{z}");
    }
    if lacks_thrust {
        arguments += " --mass-kg KG";
    }
    arguments
}

/// Names from a file without control characters, which could change the state of the terminal.
fn harmless(text: &str) -> String {
    text.replace(char::is_control, "·")
}

/// A word as a shell reads it.
fn shell_word(text: &str) -> String {
    let is_plain = |c: char| c.is_alphanumeric() || "-_./=:,+".contains(c);
    if !text.is_empty() && text.chars().all(is_plain) {
        return text.to_owned();
    }
    format!("'{}'", text.replace('\'', r"'\''"))
}

fn quantities(samples: &[Measurement]) -> Vec<Quantity> {
    let velocity = match samples.iter().find(|sample| sample.has(valid::VELOCITY)) {
        Some(sample) if sample.velocity_frame == frame::BODY => "velocity, body axes",
        _ => "velocity, inertial axes",
    };
    let found = Measurement::quantities().map(|(place, field, quantity)| {
        let name = match field.valid {
            valid::VELOCITY => velocity.into(),
            _ => quantity.key.replace('_', " "),
        };
        let name = match (quantity.unit, field.components.names) {
            ("", []) => name,
            ("", names) => format!("{name} {}", names.join(", ")),
            (unit, _) => format!("{name} ({unit})"),
        };
        quantity_of(name, samples, place, field)
    });
    found.flatten().collect()
}

fn quantity_of(name: String, samples: &[Measurement], place: usize, field: &Field) -> Option<Quantity> {
    let carrying: Vec<_> = samples.iter().filter(|sample| sample.has(field.valid)).collect();
    let mut intervals_ns: Vec<u64> =
        carrying.windows(2).map(|pair| pair[1].stamp_ns - pair[0].stamp_ns).collect();
    intervals_ns.sort_unstable();
    let extreme = |extreme: fn(f64, f64) -> f64| {
        let all = carrying.iter().map(|sample| sample.numbers(place).to_vec());
        all.reduce(|a, b| a.into_iter().zip(b).map(|(a, b)| extreme(a, b)).collect())
    };
    Some(Quantity {
        name,
        samples: carrying.len(),
        rate_hz: intervals_ns.get(intervals_ns.len() / 2).map(|&ns| 1e9 / ns as f64),
        longest_gap_s: intervals_ns.last().map_or(0.0, |&ns| ns as f64 * 1e-9),
        lowest: extreme(f64::min)?,
        highest: extreme(f64::max)?,
        noise: noise(&carrying, place, field),
    })
}

/// Samples from which a noise is told.
const MIN_SAMPLES_OF_NOISE: usize = 50;

/// `σ = median |y_j − 3 y_{j−1} + 3 y_{j−2} − y_{j−3}| / (0.6745 √20)`, for each component.
fn noise(carrying: &[&Measurement], place: usize, field: &Field) -> Vec<f64> {
    let is_measured =
        field.quantity.is_some_and(|quantity| quantity.is_measured && !quantity.unit.is_empty());
    if !is_measured || carrying.len() < MIN_SAMPLES_OF_NOISE {
        return Vec::new();
    }
    let of_component = |k: usize| {
        let y = |sample: &Measurement| sample.numbers(place)[k];
        let third = |w: &[&Measurement]| (y(w[3]) - 3.0 * y(w[2]) + 3.0 * y(w[1]) - y(w[0])).abs();
        let mut sizes: Vec<f64> = carrying.windows(4).map(third).collect();
        let middle = sizes.len() / 2;
        *sizes.select_nth_unstable_by(middle, f64::total_cmp).1 / (0.6745 * 20.0_f64.sqrt())
    };
    (0..field.components.names.len()).map(of_component).collect()
}

/// The keys that say how often a channel is measured.
fn configuration(quantities: &[Quantity]) -> Vec<String> {
    let rate_of = |start: &str| {
        let quantity = quantities.iter().find(|quantity| quantity.name.starts_with(start))?;
        quantity.rate_hz
    };
    let line = |section: &str, rate_hz: f64| format!("[{section}]\nsample_rate_hz = {rate_hz:.3}");
    let translation = rate_of("velocity").map(|rate_hz| line("translation", rate_hz));
    let rotation = rate_of("angular velocity").map(|rate_hz| line("rotation", rate_hz));
    translation.into_iter().chain(rotation).collect()
}

/// Which column may be meant for which key, from its name alone.
fn guesses(columns: &[String]) -> Vec<(String, String)> {
    const KINDS: [(&str, &[&str]); 6] = [
        ("angular_velocity", &["angularvelocity", "angvel", "gyro", "omega", "bodyrate", "rate"]),
        ("velocity", &["linearvelocity", "velocity", "vel", "v"]),
        ("position", &["position", "pos", "p", ""]),
        ("attitude", &["quaternion", "attitude", "orientation", "quat", "q"]),
        ("force", &["force", "thrust", "f"]),
        ("torque", &["torque", "moment", "tau"]),
    ];
    let mut found: Vec<(String, String)> = Vec::new();
    for column in columns {
        let bare = column.split(['[', '(']).next().unwrap_or(column).to_lowercase();
        let letters: String = bare.chars().filter(|c| c.is_alphanumeric()).collect();
        if ["time", "times", "t", "timestamp", "timesec"].contains(&letters.as_str()) {
            found.push(("time_s".into(), column.clone()));
            continue;
        }
        let mut chars = letters.chars();
        let Some(last) = chars.next_back() else { continue };
        let stem = chars.as_str();
        let Some((kind, _)) = KINDS.iter().find(|(_, names)| names.contains(&stem)) else { continue };
        let axis = match (last, *kind) {
            ('0', "attitude") => 'w',
            ('1', "attitude") | ('0', _) => 'x',
            ('2', "attitude") | ('1', _) => 'y',
            ('3', "attitude") | ('2', _) => 'z',
            ('x' | 'y' | 'z', _) | ('w', "attitude") => last,
            _ => continue,
        };
        let key = format!("{kind}_{axis}");
        if !found.iter().any(|(known, _)| *known == key) {
            found.push((key, column.clone()));
        }
    }
    found
}

impl fmt::Display for Findings {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {}", self.file, self.format)?;
        if self.samples > 0 {
            write!(f, ", {} samples in {:.2} s", self.samples, self.duration_s)?;
        }
        if let Some((start_s, end_s)) = self.airborne_s {
            write!(f, ", in the air from {start_s:.2} to {end_s:.2} s")?;
        }
        writeln!(f)?;
        if !self.quantities.is_empty() {
            writeln!(
                f,
                "\n{:<30}{:>8}{:>9}{:>9}{:>9}  range of each component",
                "", "samples", "rate Hz", "gap s", "noise"
            )?;
        }
        for quantity in &self.quantities {
            let Quantity { name, samples, rate_hz, longest_gap_s, lowest, highest, noise } = quantity;
            let rate = rate_hz.map_or("-".into(), |rate_hz| format!("{rate_hz:.1}"));
            let largest =
                noise.iter().copied().reduce(f64::max).map_or("-".into(), |noise| format!("{noise:.4}"));
            write!(f, "{name:<30}{samples:>8}{rate:>9}{longest_gap_s:>9.3}{largest:>9} ")?;
            for (low, high) in lowest.iter().zip(highest) {
                write!(f, " {low:.3}…{high:.3}")?;
            }
            writeln!(f)?;
        }
        for remark in &self.remarks {
            writeln!(f, "\n! {}", harmless(remark))?;
        }
        if !self.contents.is_empty() {
            writeln!(f, "\nIn it: {}", harmless(&self.contents.join(", ")))?;
        }
        if !self.configuration.is_empty() {
            writeln!(f, "\nIn the configuration:")?;
        }
        for line in &self.configuration {
            writeln!(f, "  {}", line.replace('\n', "\n  "))?;
        }
        writeln!(f, "\nNext:")?;
        for command in &self.commands {
            writeln!(f, "  {}", harmless(command))?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn inspected(text: &str, pairs: &[&str]) -> Findings {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("a flight.csv");
        std::fs::write(&path, text).unwrap();
        let pairs: Vec<_> = pairs.iter().map(|pair| (*pair).to_owned()).collect();
        let columns = CsvMap::read(None, &pairs).unwrap();
        inspect(&Csv, &path, &ImportOptions { columns, ..ImportOptions::default() }).unwrap()
    }

    #[test]
    fn columns_are_guessed_from_their_names() {
        let names =
            ["t", "Velocity x [m/s]", "vel.y", "v_z", "q0", "q3", "gyro_x", "Pos Z", "thrust_z", "humidity"];
        let found = guesses(&names.map(str::to_owned));
        let keys: Vec<_> = found.iter().map(|(key, _)| key.as_str()).collect();
        let expected = ["time_s", "velocity_x", "velocity_y", "velocity_z", "attitude_w", "attitude_z"];
        assert_eq!(keys, [&expected[..], &["angular_velocity_x", "position_z", "force_z"]].concat());
    }

    #[test]
    fn a_table_is_led_to_a_command_that_reads_it() {
        let text = "t;vx;vy;vz\n0;1;2;3\n0.1;1;2;3\n0.4;2;2;3\n";
        let first = inspected(text, &[]);
        assert!(first.commands[0].ends_with("a flight.csv' --column 'separator=;'"), "{first}");
        let second = inspected(text, &["separator=;"]);
        assert!(second.commands[0].ends_with("--column velocity_y=vy --column velocity_z=vz"), "{second}");
        let pairs = ["separator=;", "time_s=t", "velocity_x=vx", "velocity_y=vy", "velocity_z=vz"];
        let third = inspected(text, &pairs);
        assert_eq!((third.samples, third.quantities.len()), (3, 1));
        let velocity = &third.quantities[0];
        assert_eq!((velocity.lowest[0], velocity.highest[0]), (1.0, 2.0));
        assert!((velocity.longest_gap_s - 0.3).abs() < 1e-9 && velocity.samples == 3, "{third}");
        // As a configuration reads it.
        let configuration: toml::Table = third.configuration.join("\n").parse().unwrap();
        assert_eq!(configuration["translation"]["sample_rate_hz"].as_float(), Some(3.333));
    }

    #[test]
    fn the_noise_of_a_smooth_motion_is_told() {
        let mut text = "time_s,velocity_x,velocity_y,velocity_z\n".to_owned();
        let mut seed = 3_u64;
        let mut normal = || {
            (0..12).fold(-6.0, |sum, _| {
                seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
                sum + (seed >> 11) as f64 / (1_u64 << 53) as f64
            })
        };
        for j in 0..4000 {
            let t_s = f64::from(j) * 0.01;
            let [x, y] = [0.05 * normal(), 0.002 * normal()];
            text += &format!("{t_s},{},{},{}\n", t_s.sin() + x, (2.0 * t_s).cos() + y, (3.0 * t_s).sin());
        }
        let found = inspected(&text, &[]);
        let noise = &found.quantities[0].noise;
        assert!((noise[0] / 0.05 - 1.0).abs() < 0.1 && (noise[1] / 0.002 - 1.0).abs() < 0.1, "{noise:?}");
        assert!(noise[2] < 1e-4, "a third derivative of 27 m/s⁴: {noise:?}");
    }

    #[test]
    fn nothing_in_a_file_reaches_the_terminal_as_an_order() {
        let found = inspected("v\u{1b}x,\u{1b}[2Jboom\n1,2\n", &[]);
        assert!(found.commands[0].contains("velocity_x=v\u{1b}x"), "{found}");
        assert!(found.contents[1].contains('\u{1b}') && !found.to_string().contains('\u{1b}'), "{found}");
    }
}
