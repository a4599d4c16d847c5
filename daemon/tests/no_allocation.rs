//! Between wake-up and publication nothing is allocated, with real ports and samples of every kind.

use crate::common::TestDomain;
use allocation_counter::measure;
use daemon::assemble;
use daemon::config::ConfigFile;
use daemon::cycle::{Cycle, LoopRings};
use daemon::deadline::WakeUp;
use daemon::engine::Engine;
use daemon::limits::MAX_SAMPLES_PER_TICK;
use daemon::ports::LoopPorts;
use daemon::sensor_clocks::SensorClocks;
use daemon::snapshot::Snapshot;
use daemon::threads::recorder::{recorder, session};
use daemon::threads::snapshot_writer::saver;
use shared_types::Measurement;
use shared_types::clock::monotonic_ns;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

#[test]
fn a_tick_allocates_only_in_its_slack() {
    // Both laws, and both solvers of the gradient law.
    ["rigid-body", "rigid-body-gradient", "million-centers"]
        .into_iter()
        .for_each(ticks_of_a_service_allocate_nothing);
}

fn ticks_of_a_service_allocate_nothing(preset: &str) {
    let domain = TestDomain::new();
    let file = ConfigFile::preset(preset).unwrap();
    let (records, _records) = rtrb::RingBuffer::new(100_000);
    let (_commands, commands) = rtrb::RingBuffer::new(8);
    // With a flight record and snapshots, whose threads are not the loop's affair.
    let files = tempfile::tempdir().unwrap();
    let engine = Engine::new(&file.config, assemble::estimator(&file).unwrap());
    let path = files.path().join("vehicle.snapshot");
    let (snapshots, saver) = saver(Some(path.clone()), "vehicle", &file.config, (engine.n_learned(), false));
    let (saver, handle) = saver.unwrap();
    let session = session(&file.config, "vehicle", None);
    let (ring, recorder, recorded) =
        recorder(&files.path().join("flight"), &session, 1000.0, MAX_SAMPLES_PER_TICK).unwrap();
    let stop = Arc::new(AtomicBool::new(false));
    let (until, also_until) = (Arc::clone(&stop), Arc::clone(&stop));
    let writers = [
        std::thread::spawn(move || saver.run(&until)),
        std::thread::spawn(move || recorder.run(&also_until)),
    ];
    let rings = LoopRings { records, commands, recorder: ring, snapshots };
    let ports = LoopPorts::make(&domain.domain, "vehicle").unwrap();
    let mut cycle = Cycle::new(engine, SensorClocks::default(), ports, rings);
    let client = domain.client();
    let sensors = client.measurement_publisher().unwrap();
    let mut estimates = client.estimate_subscriber().unwrap();

    // The slack before the first sample maps the new source's segment.
    cycle.rest();
    let (mut in_ticks, mut in_slack, mut published) = (0, 0, 0);
    for j in 0..2000_u64 {
        let t = j as f64 * 0.005;
        // Stamps of their own pace: what happens in a tick does not depend on the clock.
        let stamp_ns = monotonic_ns();
        let sample = Measurement::at(stamp_ns, j)
            .with_velocity_m_s([t.sin(), t.cos(), 0.1])
            .with_angular_velocity_rad_s([0.1, 0.2, 0.3])
            .with_attitude_wxyz([1.0, 0.0, 0.0, 0.0])
            .with_force_n([1.0, 2.0, 3.0]);
        match j % 10 {
            0..=5 => drop(sensors.publish(&sample).unwrap()),
            6 => drop(sensors.publish(&sample.with_velocity_m_s([f64::NAN; 3])).unwrap()),
            // Several at once, and none at all.
            7 => (0..3).for_each(|i| {
                let sample = Measurement { stamp_ns: stamp_ns + i, sequence: j + i, ..sample };
                sensors.publish(&sample).unwrap();
            }),
            _ => {}
        }
        if j == 500 {
            let (answer, _) = std::sync::mpsc::sync_channel(1);
            handle.save_requests.send(answer).unwrap();
            // Until the saver has requested a copy.
            std::thread::sleep(Duration::from_millis(50));
        }
        let wake_ns = monotonic_ns();
        let tick = measure(|| cycle.serve(WakeUp { wake_ns, deadline_ns: Some(wake_ns) }));
        in_ticks += tick.count_total;
        in_slack += measure(|| cycle.rest()).count_total;
        while estimates.take().unwrap().is_some() {
            published += 1;
        }
    }
    stop.store(true, Ordering::Relaxed);
    writers.into_iter().for_each(|writer| writer.join().unwrap());
    assert_eq!(handle.progress.saved.load(Ordering::Relaxed), 1);
    assert!(Snapshot::read(&path).unwrap().checkpoint.learned.iter().any(|number| *number != 0.0));
    assert_eq!(recorded.written.load(Ordering::Relaxed), 2000);
    assert!(published > 1900, "{published}");
    assert!(in_slack >= 2000, "the counter sees the loans, {in_slack}");
    assert_eq!(in_ticks, 0);
}
