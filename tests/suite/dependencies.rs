//! What the crates are built from on this machine: which packages, in how many versions, under which licenses.

use lpr_tests::output_of;

/// Packages that no part of `lpr-core` may bring along: sockets, services and browsers are for the shells.
const FOREIGN_TO_THE_CORE: [&str; 8] = ["axum", "hyper", "mio", "openssl-sys", "reqwest", "tokio", "wasm-bindgen", "web-sys"];

/// Packages whose types or bits meet in one program: there is one version of each.
const ONE_VERSION: [&str; 6] = ["glam", "glamx", "libm", "parry3d", "rapier3d", "serde"];

/// Licenses under which a package may enter the binary. MPL-2.0 asks for the source of its own files only, which is public.
const LICENSES: [&str; 7] = ["Apache-2.0", "BSD-3-Clause", "CC0-1.0", "MIT", "MPL-2.0", "Unicode-3.0", "Zlib"];

/// Packages that say their license in a file of its own, which somebody has read: (name, license).
const READ: [(&str, &str); 1] = [("cfg_block", "Apache-2.0")];

/// A package that something is built from.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
struct Package {
    name: String,
    version: String,
    /// Where it comes from, unless it is the registry.
    source: String,
    license: String,
}

impl Package {
    /// From a line `name version (source)|license`.
    fn parse(line: &str) -> Self {
        let (package, license) = line.split_once('|').expect("the format asks for it");
        let package = package.replace(" (proc-macro)", "");
        let mut words = package.splitn(3, ' ');
        let mut word = || words.next().unwrap_or_default().to_owned();
        Self { name: word(), version: word(), source: word(), license: license.to_owned() }
    }
}

/// What a selection of the workspace is built from, itself included, sorted.
fn packages(selection: &[&str]) -> Vec<Package> {
    let cargo = std::env::var("CARGO").unwrap_or_else(|_| "cargo".to_owned());
    let tree = ["tree", "--offline", "--locked", "--edges", "normal,build", "--prefix", "none", "--no-dedupe"];
    let tree = output_of(&cargo, &[&tree, ["--format", "{p}|{l}"].as_slice(), selection].concat());
    let mut packages: Vec<_> = tree.lines().filter(|line| !line.is_empty()).map(Package::parse).collect();
    packages.sort();
    packages.dedup();
    assert!(packages.iter().any(|package| package.name == "glamx"), "{packages:?}");
    packages
}

fn whole_workspace() -> Vec<Package> {
    packages(&["--workspace", "--features", "lpr-core/ndarray"])
}

/// Whether one of the choices that a license expression leaves is among [`LICENSES`] in all its parts.
fn is_allowed(license: &str) -> bool {
    let license = license.replace(['(', ')'], "").replace(" / ", "/").replace('/', " OR ");
    let any_of = |part: &str| part.split(" OR ").any(|choice| LICENSES.contains(&choice.trim()));
    license.split(" AND ").all(any_of)
}

#[test]
fn a_license_is_allowed_when_one_choice_of_each_part_is() {
    for allowed in ["MIT OR GPL-3.0", "MIT/Apache-2.0", "(MIT OR Apache-2.0) AND Unicode-3.0", "Apache-2.0 / MIT"] {
        assert!(is_allowed(allowed), "{allowed}");
    }
    for refused in ["", "GPL-3.0", "MIT AND GPL-3.0", "LGPL-2.1 OR GPL-2.0", "Apache-2.0 WITH GPL-exception"] {
        assert!(!is_allowed(refused), "{refused}");
    }
}

#[test]
fn every_package_is_from_the_registry_under_a_license_that_allows_it() {
    for package in whole_workspace() {
        let is_ours = package.name.starts_with("lpr-");
        assert!(is_ours || package.source.is_empty(), "{package:?} is not from the registry");
        let read = READ.iter().find(|(name, _)| *name == package.name).map(|(_, license)| *license);
        assert!(is_allowed(read.unwrap_or(&package.license)), "{package:?}");
    }
}

#[test]
fn what_meets_in_one_program_is_there_once() {
    let packages = whole_workspace();
    for name in ONE_VERSION {
        let versions: Vec<_> = packages.iter().filter(|package| package.name == name).map(|package| &package.version).collect();
        assert_eq!(versions.len(), 1, "{name}: {versions:?}");
    }
}

#[test]
fn the_core_is_built_without_sockets_and_browser() {
    let packages = packages(&["-p", "lpr-core"]);
    let foreign: Vec<_> = packages.iter().filter(|package| FOREIGN_TO_THE_CORE.contains(&package.name.as_str())).collect();
    assert!(foreign.is_empty(), "lpr-core depends on {foreign:?}");
}

#[test]
fn planning_alone_is_built_without_networks_simulator_and_threads_of_few_packages() {
    /// Most packages, `lpr-core` included: it builds in seconds.
    const MOST: usize = 60;
    let packages = packages(&["-p", "lpr-core", "--no-default-features"]);
    assert!(packages.len() <= MOST, "{} packages", packages.len());
    for Package { name, .. } in packages {
        let is_unasked = name.starts_with("burn") || name.starts_with("rapier") || ["rayon", "toml"].contains(&name.as_str());
        assert!(!is_unasked, "planning alone depends on {name}");
    }
}
