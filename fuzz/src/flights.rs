//! Properties of every imported flight.

use importers::{ImportError, ImportOptions, Importer, RecordedFlight, parse_flight};
use shared_types::Measurement;
use shared_types::payload::valid;

/// Any bytes as a log: refused with a sentence, or a flight whose samples are numbered from 0 with unit attitudes.
pub(crate) fn check_log(importer: &dyn Importer, bytes: &[u8], options: &ImportOptions) {
    let Some(flight) = check_recording(parse_flight(importer, bytes, "fuzz", options)) else { return };
    for (sequence, sample) in flight.samples.iter().enumerate() {
        assert_eq!(sample.sequence, sequence as u64);
        assert!(!sample.has(valid::ATTITUDE) || (norm(sample) - 1.0).abs() < 1e-9, "{sample:?}");
    }
}

fn norm(sample: &Measurement) -> f64 {
    sample.attitude_wxyz.iter().map(|x| x * x).sum::<f64>().sqrt()
}

/// The same for the service's own recordings, which keep gaps and attitudes as they were; the flight, if it is one.
pub(crate) fn check_recording(flight: Result<RecordedFlight, ImportError>) -> Option<RecordedFlight> {
    let flight = match flight {
        Ok(flight) => flight,
        Err(error) => {
            assert!(!error.to_string().is_empty());
            return None;
        }
    };
    assert!(!flight.samples.is_empty());
    assert!(flight.samples.windows(2).all(|pair| pair[0].sequence < pair[1].sequence));
    for sample in &flight.samples {
        assert!(sample.is_finite(), "{sample:?}");
        assert!(!sample.has(valid::ATTITUDE) || (norm(sample) - 1.0).abs() < 0.05, "{sample:?}");
    }
    assert!(flight.samples.windows(2).all(|pair| pair[0].stamp_ns < pair[1].stamp_ns));
    assert!(flight.duration_s().is_finite());
    if let Some(part) = flight.airborne_only() {
        assert!(!part.samples.is_empty() && flight.airborne_s().is_some());
    }
    Some(flight)
}
