//! A Doppler log that speaks Water Linked's JSON over TCP (A50, A125; port 16171): its velocity reports as samples.
//!
//! One JSON document a line. Of a report of type `velocity`:
//!
//! | key | becomes |
//! |---|---|
//! | `vx`, `vy`, `vz` (m/s) | a velocity along the sensor's axes |
//! | `velocity_valid` | without bottom lock nothing is published |
//! | `covariance` ((m/s)²), else `fom` (m/s) | the deviations, at least [`Options::least_std_m_s`] |
//! | `time_of_transmission` − `time_of_validity` (µs) | how much older the reading is than the report's arrival |
//!
//! The log's clock need not be right: only that difference counts. Dead reckoning (`position_local`) is no sensor's reading, and is
//! ignored. Format: the DVL protocol of Water Linked, `json_v3`. It was tried with a server of our own alone, and with no device.

use serde::{Deserialize, Serialize};
use shared_types::client::MeasurementPublisher;
use shared_types::clock::{monotonic_ns, sleep_until_ns};
use shared_types::{Client, ClientError, Measurement, logln};
use std::fs::File;
use std::io::{self, BufRead, BufReader, BufWriter, ErrorKind, Read, Write};
use std::net::{SocketAddr, TcpListener, TcpStream, ToSocketAddrs};
use std::path::{Path, PathBuf};
use std::str::FromStr;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

/// The port of the log's server.
pub const PORT: u16 = 16171;
/// A stop is noticed, and new readers are connected, at least this often.
const PATIENCE: Duration = Duration::from_millis(50);
const CONNECT_PATIENCE: Duration = Duration::from_secs(2);
/// Between two attempts to connect (ns).
const RECONNECT_NS: u64 = 500_000_000;
/// A longer line is no report.
const MAX_LINE: usize = 1 << 16;
/// A report that says it is older than this (µs) has no times.
const MAX_AGE_US: i64 = 10_000_000;

/// A report of the velocity.
#[derive(Debug, Clone, PartialEq, Deserialize)]
pub struct VelocityReport {
    vx: f64,
    vy: f64,
    vz: f64,
    velocity_valid: bool,
    #[serde(default)]
    fom: f64,
    covariance: Option<[[f64; 3]; 3]>,
    time_of_validity: Option<i64>,
    time_of_transmission: Option<i64>,
    /// Since the report before (ms).
    #[serde(default)]
    time: f64,
}

/// What a line is.
#[derive(Debug, Clone, PartialEq)]
pub enum Line {
    /// A report of the velocity.
    Velocity(VelocityReport),
    /// Dead reckoning, an answer to a command: nothing to use.
    Other,
    /// Not readable.
    Unreadable,
}

impl Line {
    /// Reads a line.
    pub fn parse(text: &str) -> Self {
        #[derive(Deserialize)]
        struct Kind {
            #[serde(rename = "type")]
            kind: String,
        }
        match serde_json::from_str::<Kind>(text) {
            // The second version of the format has no types.
            Ok(Kind { kind }) if kind != "velocity" => Self::Other,
            Ok(_) | Err(_) => serde_json::from_str(text).map_or(Self::Unreadable, Self::Velocity),
        }
    }
}

impl VelocityReport {
    /// How much older the reading is than the report (ns); `None` where it does not say.
    fn age_ns(&self) -> Option<u64> {
        let age_us = self.time_of_transmission? - self.time_of_validity?;
        (0..MAX_AGE_US).contains(&age_us).then_some(age_us as u64 * 1000)
    }

    /// The sample of a report that arrived at `arrival_ns`; `None` without bottom lock.
    pub fn sample(&self, arrival_ns: u64, sequence: u64, options: &Options) -> Option<Measurement> {
        if !self.velocity_valid {
            return None;
        }
        let std = |axis: usize| {
            let variance = self.covariance.map_or(0.0, |covariance| covariance[axis][axis]);
            let std = if variance > 0.0 { variance.sqrt() } else { self.fom };
            std.max(options.least_std_m_s)
        };
        let stamp_ns = arrival_ns.saturating_sub(self.age_ns().unwrap_or(0));
        let sample = Measurement::at(stamp_ns, sequence).of_sensor(options.sensor);
        let sample = sample.with_body_velocity_m_s([self.vx, self.vy, self.vz]);
        Some(sample.with_velocity_std_m_s(std::array::from_fn(std)))
    }
}

/// Where the reports come from.
#[derive(Debug, Clone, PartialEq)]
pub enum Origin {
    /// A log, or a forwarder, to connect to.
    Connect(TcpAddress),
    /// A forwarder connects to us.
    Listen(TcpAddress),
    /// Lines that were recorded, at the pace of their times.
    Replay(PathBuf),
}

/// `tcp:HOST[:PORT]`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct TcpAddress(String);

impl FromStr for TcpAddress {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let needed = || format!("'{text}': needed: tcp:HOST[:PORT], for example tcp:192.168.2.95:{PORT}");
        let place = text.strip_prefix("tcp:").filter(|place| !place.is_empty()).ok_or_else(needed)?;
        let has_port =
            place.rsplit_once(':').is_some_and(|(host, _)| !host.contains(':') || host.ends_with(']'));
        let place = if has_port { place.into() } else { format!("{place}:{PORT}") };
        let (host, port) = place.rsplit_once(':').ok_or_else(needed)?;
        port.parse::<u16>().map_err(|_| needed())?;
        if host.is_empty() { Err(needed()) } else { Ok(Self(place)) }
    }
}

impl std::fmt::Display for TcpAddress {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "tcp:{}", self.0)
    }
}

impl TcpAddress {
    fn resolve(&self) -> io::Result<SocketAddr> {
        self.0.to_socket_addrs()?.next().ok_or_else(|| io::Error::other("no such host"))
    }
}

/// How to read a log.
#[derive(Debug, Clone, PartialEq)]
pub struct Options {
    /// Where from.
    pub origin: Origin,
    /// `sensor` of the samples.
    pub sensor: u32,
    /// The least deviation that is told (m/s).
    pub least_std_m_s: f64,
    /// Where to write every line that comes.
    pub record: Option<PathBuf>,
    /// How long (s); `None` until the stop.
    pub duration_s: Option<f64>,
}

/// What came.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize)]
pub struct DvlCounts {
    /// Samples published.
    pub samples_published: u64,
    /// Reports without bottom lock.
    pub without_bottom_lock: u64,
    /// Lines that are no velocity: dead reckoning, answers.
    pub other_lines: u64,
    /// Lines that are no report at all.
    pub unreadable_lines: u64,
    /// How often the connection was made.
    pub connections: u64,
    /// Reports that do not say how old they are.
    pub without_times: u64,
}

/// Why it ends without having done its work.
#[derive(Debug, thiserror::Error)]
pub enum DvlError {
    /// An address cannot be used.
    #[error("{address}: {cause}")]
    Address {
        /// Which.
        address: TcpAddress,
        /// Why.
        cause: io::Error,
    },
    /// A file cannot be read or written.
    #[error("'{path}': {cause}")]
    File {
        /// Which.
        path: PathBuf,
        /// Why.
        cause: io::Error,
    },
    /// Shared memory failed.
    #[error(transparent)]
    Client(#[from] ClientError),
}

/// Publishes the reports as samples until `stop`, the end of the time or that of the replay.
///
/// # Errors
/// `Address` where nothing can listen there, `File`, `Client`. A connection that fails is tried again.
pub fn run(client: &Client, options: &Options, stop: &AtomicBool) -> Result<DvlCounts, DvlError> {
    let file = |path: &Path| {
        let path = path.to_owned();
        move |cause| DvlError::File { path, cause }
    };
    let record = match &options.record {
        Some(path) => Some((path.clone(), BufWriter::new(File::create(path).map_err(file(path))?))),
        None => None,
    };
    let end_ns = options.duration_s.map_or(u64::MAX, |s| monotonic_ns().saturating_add((s * 1e9) as u64));
    let mut bridge = Bridge {
        publisher: client.measurement_publisher()?,
        options,
        record,
        sequence: 0,
        has_lock: None,
        counts: DvlCounts::default(),
    };
    let is_over = || stop.load(Ordering::Relaxed) || monotonic_ns() >= end_ns;
    match &options.origin {
        Origin::Connect(address) => bridge.connect(address, &is_over)?,
        Origin::Listen(address) => bridge.listen(address, &is_over)?,
        Origin::Replay(path) => bridge.replay(path, &is_over)?,
    }
    if let Some((path, record)) = &mut bridge.record {
        record.flush().map_err(file(path))?;
    }
    Ok(bridge.counts)
}

struct Bridge<'a> {
    publisher: MeasurementPublisher,
    options: &'a Options,
    record: Option<(PathBuf, BufWriter<File>)>,
    sequence: u64,
    has_lock: Option<bool>,
    counts: DvlCounts,
}

impl Bridge<'_> {
    fn connect(&mut self, address: &TcpAddress, is_over: &impl Fn() -> bool) -> Result<(), DvlError> {
        let mut is_told = false;
        while !is_over() {
            let opened = address.resolve().and_then(|at| TcpStream::connect_timeout(&at, CONNECT_PATIENCE));
            match opened {
                Ok(stream) => {
                    logln!("connected to {address}");
                    is_told = false;
                    self.read(stream, is_over)?;
                }
                Err(cause) if !std::mem::replace(&mut is_told, true) => {
                    logln!("no connection to {address}: {cause}; trying again");
                }
                Err(_) => {}
            }
            self.pause(RECONNECT_NS, is_over)?;
        }
        Ok(())
    }

    fn listen(&mut self, address: &TcpAddress, is_over: &impl Fn() -> bool) -> Result<(), DvlError> {
        let listening = address.resolve().and_then(TcpListener::bind).and_then(|listener| {
            listener.set_nonblocking(true)?;
            Ok(listener)
        });
        let listener = listening.map_err(|cause| DvlError::Address { address: address.clone(), cause })?;
        while !is_over() {
            match listener.accept() {
                Ok((stream, peer)) => {
                    logln!("{peer} connected");
                    self.read(stream, is_over)?;
                }
                Err(_) => self.pause(PATIENCE.as_nanos() as u64, is_over)?,
            }
        }
        Ok(())
    }

    fn pause(&mut self, pause_ns: u64, is_over: &impl Fn() -> bool) -> Result<(), DvlError> {
        let until_ns = monotonic_ns() + pause_ns;
        while monotonic_ns() < until_ns && !is_over() {
            self.publisher.update_connections()?;
            sleep_until_ns(until_ns.min(monotonic_ns() + PATIENCE.as_nanos() as u64));
        }
        Ok(())
    }

    /// Reads lines until the connection ends.
    fn read(&mut self, mut stream: TcpStream, is_over: &impl Fn() -> bool) -> Result<(), DvlError> {
        self.counts.connections += 1;
        // Without a timeout a stop would wait for the next report: a system that refuses it is a system without sockets.
        if stream.set_nonblocking(false).and_then(|()| stream.set_read_timeout(Some(PATIENCE))).is_err() {
            return Ok(());
        }
        let (mut pending, mut chunk) = (Vec::new(), [0; 4096]);
        while !is_over() {
            self.publisher.update_connections()?;
            match stream.read(&mut chunk) {
                Ok(0) => break,
                Ok(n) => {
                    let arrival_ns = monotonic_ns();
                    pending.extend_from_slice(&chunk[..n]);
                    while let Some(end) = pending.iter().position(|byte| *byte == b'\n') {
                        let line: Vec<u8> = pending.drain(..=end).collect();
                        self.take(&String::from_utf8_lossy(&line), arrival_ns)?;
                    }
                    if pending.len() > MAX_LINE {
                        pending.clear();
                        self.counts.unreadable_lines += 1;
                    }
                }
                Err(error) if [ErrorKind::WouldBlock, ErrorKind::TimedOut].contains(&error.kind()) => {}
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(_) => break,
            }
        }
        if !is_over() {
            logln!("the connection ended");
        }
        Ok(())
    }

    fn replay(&mut self, path: &Path, is_over: &impl Fn() -> bool) -> Result<(), DvlError> {
        let failed = |cause| DvlError::File { path: path.to_owned(), cause };
        let lines = BufReader::new(File::open(path).map_err(failed)?).lines();
        self.pause(2 * PATIENCE.as_nanos() as u64, is_over)?;
        let mut due_ns = monotonic_ns();
        let mut before_us: Option<i64> = None;
        for line in lines {
            let line = line.map_err(failed)?;
            if let Line::Velocity(report) = Line::parse(&line) {
                let since_us = match (report.time_of_transmission, before_us) {
                    (Some(now_us), Some(before_us)) => (now_us - before_us).clamp(0, 60_000_000) as f64,
                    (None, _) => report.time.clamp(0.0, 60_000.0) * 1e3,
                    (Some(_), None) => 0.0,
                };
                before_us = report.time_of_transmission.or(before_us);
                due_ns += (since_us * 1e3) as u64;
            }
            self.pause(due_ns.saturating_sub(monotonic_ns()), is_over)?;
            if is_over() {
                break;
            }
            self.take(&line, monotonic_ns())?;
        }
        Ok(())
    }

    fn take(&mut self, line: &str, arrival_ns: u64) -> Result<(), DvlError> {
        let line = line.trim();
        if line.is_empty() {
            return Ok(());
        }
        if let Some((path, record)) = &mut self.record {
            let written = writeln!(record, "{line}");
            written.map_err(|cause| DvlError::File { path: path.clone(), cause })?;
        }
        let report = match Line::parse(line) {
            Line::Velocity(report) => report,
            Line::Other => {
                self.counts.other_lines += 1;
                return Ok(());
            }
            Line::Unreadable => {
                self.counts.unreadable_lines += 1;
                return Ok(());
            }
        };
        let has_lock = report.velocity_valid;
        if self.has_lock.replace(has_lock).is_some_and(|before| before != has_lock) {
            logln!(
                "{}",
                if has_lock { "bottom lock is back" } else { "bottom lock is lost: nothing is published" }
            );
        }
        if report.age_ns().is_none() {
            if self.counts.without_times == 0 {
                logln!(
                    "the reports do not say how old they are: latency_s of the sensor in the service's configuration \
                     stands for it"
                );
            }
            self.counts.without_times += 1;
        }
        match report.sample(arrival_ns, self.sequence, self.options) {
            Some(sample) => {
                self.publisher.publish(&sample)?;
                self.sequence += 1;
                self.counts.samples_published += 1;
            }
            None => self.counts.without_bottom_lock += 1,
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use shared_types::payload::{frame, valid};

    fn options() -> Options {
        let origin = Origin::Replay("dive.json".into());
        Options { origin, sensor: 2, least_std_m_s: 0.001, record: None, duration_s: None }
    }

    fn report(more: &str) -> String {
        format!(
            "{{\"time\":106.4,\"vx\":0.5,\"vy\":-0.25,\"vz\":0.125,\"fom\":0.004,\"altitude\":2.5,\"transducers\":[],\
             \"status\":0,\"format\":\"json_v3.1\",\"type\":\"velocity\",{more}}}"
        )
    }

    #[test]
    fn a_velocity_is_as_old_as_its_times_say_and_as_sure_as_its_covariance() {
        let text = report(
            "\"velocity_valid\":true,\"covariance\":[[1e-4,0,0],[0,4e-4,0],[0,0,1e-9]],\
             \"time_of_validity\":1638191471563017,\"time_of_transmission\":1638191471752336",
        );
        let Line::Velocity(report) = Line::parse(&text) else { panic!("{text}") };
        let sample = report.sample(5_000_000_000, 7, &options()).unwrap();
        assert_eq!((sample.stamp_ns, sample.sequence, sample.sensor), (5_000_000_000 - 189_319_000, 7, 2));
        assert_eq!((sample.valid, sample.velocity_frame), (valid::VELOCITY, frame::BODY));
        assert_eq!(sample.velocity_m_s, [0.5, -0.25, 0.125]);
        assert_eq!(sample.velocity_std_m_s, [0.01, 0.02, 0.001]);
    }

    #[test]
    fn an_older_format_has_the_figure_of_merit_and_no_age() {
        let Line::Velocity(report) = Line::parse(&report("\"velocity_valid\":true")) else { panic!() };
        let sample = report.sample(9, 0, &options()).unwrap();
        assert_eq!((sample.stamp_ns, sample.velocity_std_m_s), (9, [0.004; 3]));
        let untyped = "{\"vx\":1,\"vy\":0,\"vz\":0,\"fom\":0.01,\"velocity_valid\":true}";
        assert!(matches!(Line::parse(untyped), Line::Velocity(_)));
    }

    #[test]
    fn without_bottom_lock_zeros_are_no_velocity() {
        let text = "{\"vx\":0,\"vy\":0,\"vz\":0,\"fom\":2.7,\"velocity_valid\":false,\"type\":\"velocity\"}";
        let Line::Velocity(report) = Line::parse(text) else { panic!() };
        assert!(report.sample(1, 0, &options()).is_none());
    }

    #[test]
    fn what_is_no_velocity_is_told_apart_from_what_is_nothing() {
        let position =
            "{\"ts\":49056.8,\"x\":12.4,\"y\":64.6,\"z\":1.7,\"std\":0.1,\"type\":\"position_local\"}";
        assert_eq!(Line::parse(position), Line::Other);
        let answer = "{\"response_to\":\"get_config\",\"success\":true,\"type\":\"response\"}";
        assert_eq!(Line::parse(answer), Line::Other);
        for text in ["", "{", "wrx,112.83,0.007*d2", "{\"vx\":null,\"type\":\"velocity\"}", "[1,2]"] {
            assert_eq!(Line::parse(text), Line::Unreadable, "{text}");
        }
    }

    #[test]
    fn an_address_has_the_log_s_port_where_it_has_none() {
        let address = |text: &str| text.parse::<TcpAddress>();
        assert_eq!(address("tcp:192.168.2.95").unwrap().to_string(), "tcp:192.168.2.95:16171");
        assert_eq!(address("tcp:log:4000").unwrap().to_string(), "tcp:log:4000");
        assert_eq!(address("tcp:[::1]:4000").unwrap().to_string(), "tcp:[::1]:4000");
        for text in ["192.168.2.95", "udp:1.2.3.4", "tcp:", "tcp::80", "tcp:log:port"] {
            assert!(address(text).unwrap_err().contains("needed: tcp:HOST[:PORT]"), "{text}");
        }
    }
}
