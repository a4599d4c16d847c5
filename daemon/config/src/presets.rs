//! The built-in configurations.

/// The built-in configurations: name, text.
pub const PRESETS: [(&str, &str); 9] = [
    ("rigid-body", include_str!("../../presets/rigid-body.toml")),
    ("rigid-body-gradient", include_str!("../../presets/rigid-body-gradient.toml")),
    ("paper-translation-joint", include_str!("../../presets/paper-translation-joint.toml")),
    ("paper-translation", include_str!("../../presets/paper-translation.toml")),
    ("paper-rotation", include_str!("../../presets/paper-rotation.toml")),
    ("acsl-x8", include_str!("../../presets/acsl-x8.toml")),
    ("auv", include_str!("../../presets/auv.toml")),
    ("linear", include_str!("../../presets/linear.toml")),
    ("million-centers", include_str!("../../presets/million-centers.toml")),
];
