//! `daemon config`, `config-reference` and `iceoryx2-config`: print configurations of the service and of iceoryx2.

use super::arguments::DesignArguments;
use crate::assemble;
use crate::config::reference;
use anyhow::Context;
use shared_types::{Domain, outln};
use std::path::Path;

/// Prints the effective configuration.
pub(super) fn effective(design: &DesignArguments) -> anyhow::Result<()> {
    let file = design.read()?;
    assemble::estimator(&file)?;
    outln!("{}", file.commented_toml().trim_end());
    Ok(())
}

/// Prints what every key means.
pub(super) fn print_reference(schema: bool) {
    let text = if schema { reference::json_schema() } else { reference::markdown() };
    outln!("{}", text.trim_end());
}

/// Prints the domain's iceoryx2 configuration.
pub(super) fn iceoryx2(root: Option<&Path>) -> anyhow::Result<()> {
    let domain = Domain::at_or_of_user(root)?;
    // Another program would make the root path accessible to its group and without our lock.
    drop(domain.lock_for_making()?);
    let config =
        toml::to_string(&shared_types::service::config_for_others(&domain)).context("write as TOML")?;
    outln!("{}", config.trim_end());
    Ok(())
}
