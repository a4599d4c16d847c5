//! The vehicle's side of a measured exchange: sends a sample and waits for the estimate that contains it.

use super::processes::{Child, OwnDomain, PATIENCE, ServiceSettings};
use anyhow::{Context, bail};
use daemon::deadline::wait_for_deadline;
use shared_types::client::{MeasurementPublisher, Stream};
use shared_types::clock::monotonic_ns;
use shared_types::payload::{Estimate, Status, command};
use shared_types::{Client, Measurement};
use std::sync::atomic::{AtomicBool, Ordering};

/// Samples of a vehicle that accelerates all the time, so that there is something to learn at every step.
#[derive(Debug, Default)]
pub(crate) struct MovingVehicle {
    sequence: u64,
}

impl MovingVehicle {
    /// The next sample, stamped now.
    pub(crate) fn sample(&mut self) -> Measurement {
        let sequence = self.sequence;
        self.sequence += 1;
        let now_ns = monotonic_ns();
        // Outputs that swing within a few seconds; the phase only distinguishes the axes.
        let swing = |phase: f64| (3.0 * (now_ns as f64 * 1e-9 + phase)).sin();
        let vector = |scale: f64| [scale * swing(0.0), scale * swing(1.0), scale * swing(2.0)];
        let sample = Measurement::at(0, sequence)
            .with_velocity_m_s(vector(1.5))
            .with_angular_velocity_rad_s(vector(0.8))
            .with_force_n([0.0, 0.0, -19.6])
            .with_torque_n_m([0.0; 3]);
        Measurement { stamp_ns: monotonic_ns(), ..sample }
    }
}

/// The times of an exchange, from the estimate's stamps.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Reply {
    /// Sequence of the sample that it contains.
    pub(crate) source_sequence: u64,
    /// When the other side had taken the sample (ns).
    pub(crate) taken_stamp_ns: u64,
    /// When the other side sent the estimate (ns).
    pub(crate) publish_stamp_ns: u64,
}

impl From<&Estimate> for Reply {
    fn from(estimate: &Estimate) -> Self {
        Self {
            source_sequence: estimate.source_sequence,
            taken_stamp_ns: estimate.stamp_ns,
            publish_stamp_ns: estimate.publish_stamp_ns,
        }
    }
}

/// A connection for samples and estimates.
pub(crate) trait Exchange {
    fn send(&mut self, sample: &Measurement) -> anyhow::Result<()>;
    /// The oldest reply not yet taken.
    fn poll(&mut self) -> anyhow::Result<Option<Reply>>;
}

/// An exchange through the service, with its client.
pub(crate) struct ServiceExchange {
    samples: MeasurementPublisher,
    estimates: Stream<Estimate>,
}

impl ServiceExchange {
    pub(crate) fn of(client: &Client) -> anyhow::Result<Self> {
        Ok(Self { samples: client.measurement_publisher()?, estimates: client.estimate_subscriber()? })
    }
}

impl Exchange for ServiceExchange {
    fn send(&mut self, sample: &Measurement) -> anyhow::Result<()> {
        self.samples.publish(sample)?;
        Ok(())
    }

    fn poll(&mut self) -> anyhow::Result<Option<Reply>> {
        Ok(self.estimates.take()?.map(|estimate| Reply::from(&estimate)))
    }
}

/// The parts of one exchange: from the sample's stamp to the other side, the time there, and back.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Trip {
    pub(crate) there_ns: u64,
    pub(crate) inside_ns: u64,
    pub(crate) back_ns: u64,
    pub(crate) whole_ns: u64,
}

/// A poll costs about 100 ns, so the clock of the deadline is read every few microseconds.
const LOOKS_BETWEEN_CLOCKS: usize = 64;

/// Sends the vehicle's next sample and polls for the estimate that contains it; `None` if none arrives in time.
pub(crate) fn round_trip(
    exchange: &mut impl Exchange,
    vehicle: &mut MovingVehicle,
    patience_ns: u64,
) -> anyhow::Result<Option<Trip>> {
    let sample = vehicle.sample();
    exchange.send(&sample)?;
    loop {
        for _ in 0..LOOKS_BETWEEN_CLOCKS {
            let Some(reply) = exchange.poll()? else { continue };
            // A tick between two samples repeats the older one's sequence.
            if reply.source_sequence < sample.sequence || reply.taken_stamp_ns < sample.stamp_ns {
                continue;
            }
            let received_ns = monotonic_ns();
            return Ok(Some(Trip {
                there_ns: reply.taken_stamp_ns - sample.stamp_ns,
                inside_ns: reply.publish_stamp_ns.saturating_sub(reply.taken_stamp_ns),
                back_ns: received_ns.saturating_sub(reply.publish_stamp_ns),
                whole_ns: received_ns - sample.stamp_ns,
            }));
        }
        if monotonic_ns() - sample.stamp_ns > patience_ns {
            return Ok(None);
        }
    }
}

/// Exchanges until the other side answers: it may have to connect first.
pub(crate) fn connect(exchange: &mut impl Exchange, vehicle: &mut MovingVehicle) -> anyhow::Result<()> {
    const TRIES: usize = 100;
    for _ in 0..TRIES {
        if round_trip(exchange, vehicle, 50_000_000)?.is_some() {
            return Ok(());
        }
    }
    bail!(
        "no estimate holds the samples that were sent: does the preset use velocities or angular velocities?"
    )
}

/// The result of driving a service.
#[derive(Debug, Default)]
pub(crate) struct Seen {
    /// Sample's stamp to the estimate's arrival (ns).
    pub(crate) source_to_estimate_ns: Vec<u64>,
    /// Samples whose estimate did not arrive within two periods.
    pub(crate) unanswered: u64,
    /// Samples that were due while the estimate before was still awaited, and not sent.
    pub(crate) skipped: u64,
    /// The service's own counts at the end.
    pub(crate) status: Status,
    /// Memory that all ports take.
    pub(crate) shm_bytes: u64,
}

/// The publisher of the samples polls the clock for this long before each.
const VEHICLE_SPIN_NS: u64 = 200_000;

/// Runs one service on that core in a domain of its own, sends it samples at its rate, and polls for their estimates.
/// Further readers, up to `n_readers` in all, look after each estimate.
pub(crate) fn drive_service(
    settings: &ServiceSettings<'_>,
    core: usize,
    n_readers: u64,
    seconds: f64,
    stop: &AtomicBool,
) -> anyhow::Result<Seen> {
    let domain = OwnDomain::new()?;
    let service = Child::start_service(&domain, "vehicle", settings, &[core])?;
    let client = service.connect(&domain, "vehicle")?;
    let mut exchange = ServiceExchange::of(&client)?;
    let others = (1..n_readers).map(|_| client.estimate_subscriber());
    let mut others = others.collect::<Result<Vec<_>, _>>()?;
    let mut vehicle = MovingVehicle::default();
    connect(&mut exchange, &mut vehicle).or_else(|error| Err(error).with_context(|| service.log()))?;
    let look = || {
        for reader in &mut others {
            while let Ok(Some(_)) = reader.take() {}
        }
    };
    let mut seen = send_at_rate(&mut exchange, &mut vehicle, settings.rate_hz, seconds, look, stop)?;
    seen.status = client.command(command::STATUS, PATIENCE)?.status;
    seen.shm_bytes = domain.shm_bytes()?;
    drop((others, exchange, client));
    service.stop()?;
    Ok(seen)
}

/// Sends samples at a rate and polls for the estimate of each; `between` is called after each.
fn send_at_rate(
    exchange: &mut ServiceExchange,
    vehicle: &mut MovingVehicle,
    rate_hz: f64,
    seconds: f64,
    mut between: impl FnMut(),
    stop: &AtomicBool,
) -> anyhow::Result<Seen> {
    let n_samples = (seconds * rate_hz).ceil().max(1.0);
    let period_ns = 1e9 / rate_hz * (1.0 + 1.0 / n_samples);
    let start_ns = monotonic_ns() + period_ns as u64;
    let mut seen = Seen::default();
    for i in 0..n_samples as u64 {
        if stop.load(Ordering::Relaxed) {
            break;
        }
        let due_ns = start_ns + (i as f64 * period_ns) as u64;
        // An estimate that came after the next sample was due: that one is left out, and counted.
        if monotonic_ns() > due_ns {
            seen.skipped += 1;
            continue;
        }
        wait_for_deadline(due_ns, VEHICLE_SPIN_NS);
        match round_trip(exchange, vehicle, 2 * period_ns as u64)? {
            Some(trip) => seen.source_to_estimate_ns.push(trip.whole_ns),
            None => seen.unanswered += 1,
        }
        between();
    }
    Ok(seen)
}
