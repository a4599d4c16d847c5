//! Any text as a configuration: an error message or an estimator, no panic. An accepted configuration, printed, reads back as
//! itself.

use daemon::assemble;
use daemon::config::{Config, ConfigFile};

/// A design takes N³ operations: those of more centers are parsed and printed, not built.
const MAX_CENTERS: usize = 64;

pub(crate) fn run(bytes: &[u8]) {
    let Ok(text) = str::from_utf8(bytes) else { return };
    let file = match ConfigFile::parse("fuzz".into(), text.into()) {
        Ok(file) => file,
        Err(error) => return assert!(!error.to_string().is_empty()),
    };
    let printed = file.commented_toml();
    let again =
        ConfigFile::parse("printed".into(), printed.clone()).unwrap_or_else(|e| panic!("{e}\n{printed}"));
    assert_eq!(
        again.commented_toml().lines().skip(1).collect::<Vec<_>>(),
        printed.lines().skip(1).collect::<Vec<_>>()
    );
    if n_centers(&file.config) <= MAX_CENTERS {
        match assemble::estimator(&file) {
            Ok(mut estimator) => {
                let estimate = daemon::engine::to_payload(&estimator.estimate(1));
                assert!(estimate.is_finite(), "{estimate:?}");
            }
            Err(error) => {
                assert!(error.what.contains("needed: ") || error.what.contains("neither"), "{error}")
            }
        }
    }
}

fn n_centers(config: &Config) -> usize {
    let product =
        |counts: &[usize]| counts.iter().fold(1_usize, |product, &n| product.saturating_mul(n.max(1)));
    let lattice_or_list = |counts: Option<&[usize]>, listed: Option<usize>| {
        counts.map_or(0, product).saturating_add(listed.unwrap_or(0))
    };
    let translation = config.translation.as_ref().map_or(0, |t| {
        lattice_or_list(
            t.centers_per_axis.as_ref().map(|n| n.as_slice()),
            t.centers_listed_m_s.as_ref().map(Vec::len),
        )
    });
    let rotation = config.rotation.as_ref().map_or(0, |r| {
        lattice_or_list(
            r.centers_per_axis.as_ref().map(|n| n.as_slice()),
            r.centers_listed_rad_s.as_ref().map(Vec::len),
        )
    });
    let linear = config.linear.as_ref().map_or(0, |l| {
        lattice_or_list(l.centers_per_axis.as_deref(), l.centers_listed.as_ref().map(Vec::len))
    });
    translation.saturating_add(rotation).saturating_add(linear)
}
