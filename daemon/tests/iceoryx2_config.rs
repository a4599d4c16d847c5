//! `daemon iceoryx2-config`: a program that is not ours joins the domain with this configuration.

use crate::common::{Ended, TestDomain, daemon_command, run_daemon};
use iceoryx2::config::Config;
use iceoryx2::prelude::*;
use shared_types::Estimate;
use std::os::unix::fs::PermissionsExt;

#[test]
fn a_node_with_the_printed_configuration_sees_the_services_and_its_mirrors_keep_as_much() {
    let domain = TestDomain::new();
    std::fs::remove_dir(domain.root()).unwrap();
    let Ended { code, out: text, log } = Ended::of(&mut daemon_command(&domain, &["iceoryx2-config"]));
    assert_eq!((code, log.as_str()), (Some(0), ""));
    let mode = std::fs::metadata(domain.root()).unwrap().permissions().mode();
    assert_eq!(mode & 0o777, 0o700, "the root path is made, and is its owner's alone");

    let file = domain.state.path().join("iceoryx2.toml");
    std::fs::write(&file, text).unwrap();
    let path = FilePath::new(file.to_str().unwrap().as_bytes()).unwrap();
    let config = Config::from_file(&path).unwrap();
    assert_eq!(config, shared_types::service::config_for_others(&domain.domain));

    let daemon = run_daemon(&domain, &["--preset", "linear"]);
    domain.client();
    let node = NodeBuilder::new()
        .config(&config)
        .signal_handling_mode(SignalHandlingMode::Disabled)
        .create::<ipc::Service>()
        .unwrap();
    let topic = |name: &str| node.service_builder(&name.try_into().unwrap()).publish_subscribe::<Estimate>();
    let theirs = topic("vehicle/estimate").open().unwrap();
    let mirror = topic("mirror/estimate").open_or_create().unwrap();
    let (ours, others) = (mirror.static_config(), theirs.static_config());
    assert_eq!(ours.subscriber_max_buffer_size(), others.subscriber_max_buffer_size());
    assert_eq!(ours.history_size(), others.history_size());
    assert_eq!(ours.max_subscribers(), others.max_subscribers());
    assert!(ours.has_safe_overflow());
    drop((theirs, mirror, node));
    assert_eq!(daemon.stop().code, Some(0));
    domain.domain.remove_if_unused().unwrap();
    domain.assert_clean();
}
