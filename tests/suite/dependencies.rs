//! Which packages `lpr-xarm` and the parts of `lpr-core` bring along, feature by feature. What holds
//! for all of the workspace is in `deny.toml`.

use lpr_tests::output_of;
use std::collections::BTreeSet;

/// Packages that no part of `lpr-core` may bring along: sockets, services and browsers are for the
/// shells.
const FOREIGN_TO_THE_CORE: [&str; 8] =
    ["axum", "hyper", "mio", "openssl-sys", "reqwest", "tokio", "wasm-bindgen", "web-sys"];

/// Names of the packages that a selection of the workspace is built from on this machine, itself
/// included, sorted.
fn packages(selection: &[&str]) -> Vec<String> {
    let cargo = std::env::var("CARGO").unwrap_or_else(|_| "cargo".to_owned());
    let tree = [
        "tree",
        "--offline",
        "--locked",
        "--edges",
        "normal,build",
        "--prefix",
        "none",
        "--no-dedupe",
        "--format",
        "{p}",
    ];
    let tree = output_of(&cargo, &[&tree, selection].concat());
    let lines: BTreeSet<_> = tree.lines().filter(|line| !line.is_empty()).collect();
    let packages: Vec<_> = lines
        .into_iter()
        .filter_map(|line| line.split_whitespace().next())
        .map(str::to_owned)
        .collect();
    assert!(packages.iter().any(|name| name == "glamx"), "{packages:?}");
    packages
}

#[test]
fn the_core_is_built_without_sockets_and_browser() {
    let packages = packages(&["-p", "lpr-core"]);
    let foreign: Vec<_> =
        packages.iter().filter(|name| FOREIGN_TO_THE_CORE.contains(&name.as_str())).collect();
    assert!(foreign.is_empty(), "lpr-core depends on {foreign:?}");
}

#[test]
fn planning_alone_is_built_without_networks_simulator_and_threads_of_few_packages() {
    /// Most packages, `lpr-core` included: it builds in seconds.
    const MOST: usize = 60;
    let packages = packages(&["-p", "lpr-core", "--no-default-features"]);
    assert!(packages.len() <= MOST, "{} packages", packages.len());
    for name in packages {
        let is_unasked = name.starts_with("burn")
            || name.starts_with("rapier")
            || ["rayon", "toml"].contains(&name.as_str());
        assert!(!is_unasked, "planning alone depends on {name}");
    }
}

/// Who audits what moves hardware builds this crate alone.
#[test]
fn the_arm_is_moved_without_networks_simulator_services_and_runtime() {
    let packages = packages(&["-p", "lpr-xarm"]);
    let foreign: Vec<_> = packages
        .iter()
        .filter(|name| {
            FOREIGN_TO_THE_CORE.contains(&name.as_str())
                || ["rayon", "lpr-server"].contains(&name.as_str())
                || ["burn", "rapier", "sqlx", "libsqlite3"].iter().any(|it| name.starts_with(it))
        })
        .collect();
    assert!(foreign.is_empty(), "lpr-xarm depends on {foreign:?}");
    assert!(packages.iter().any(|name| name == "lpr-core"), "{packages:?}");
}
