//! The promises of `lpr-core` and `lpr-xarm` to others: every public item with its signature, as
//! `tests/golden/public-api*.txt` list them.
//!
//! The compiler refuses `pub` where nothing public leads (`unreachable_pub`), so what is `pub` in
//! the sources is public. What planning alone has is what stands under no `#[cfg(feature)]` in
//! `lib.rs`.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

use lpr_tests::{project_files, workspace};
use std::fs;
use std::path::Path;

/// With this variable the test writes the list anew.
const RENEW: &str = "LPR_RENEW_GOLDEN";

/// A public item as one line: what it is in (an `impl`, or nothing) and its declaration.
fn items(source: &str) -> Vec<String> {
    let lines: Vec<&str> =
        source.lines().map(|line| line.split(" // ").next().unwrap_or_default()).collect();
    let mut items = Vec::new();
    let (mut owner, mut gate) = (String::new(), String::new());
    let mut at = 0;
    while at < lines.len() {
        let line = lines[at];
        let is_test = line.starts_with("#[cfg(test)]")
            && lines.get(at + 1).is_some_and(|next| next.ends_with('{'));
        if is_test {
            break;
        }
        if line.starts_with("impl") {
            owner = declaration(&lines[at..]).0;
        } else if line == "}" {
            owner.clear();
        }
        if line.trim_start().starts_with("#[cfg(") {
            gate = format!("{} ", line.trim());
        } else if line.trim_start().starts_with("pub ") {
            let (text, n_lines) = declaration(&lines[at..]);
            let owner = if line.starts_with(' ') && !owner.is_empty() {
                format!("{owner}: ")
            } else {
                String::new()
            };
            items.push(format!("{gate}{owner}{text}"));
            at += n_lines - 1;
        }
        if !line.trim_start().starts_with(['#', '/']) {
            gate.clear();
        }
        at += 1;
    }
    items
}

/// The declaration that begins the lines, up to its body, and how many lines it has. Of enums and
/// traits the body belongs to it.
fn declaration(lines: &[&str]) -> (String, usize) {
    let is_whole = ["pub enum ", "pub trait "].iter().any(|start| lines[0].starts_with(start))
        && !lines[0].ends_with('}');
    let ends = |line: &str| {
        if is_whole { line == "}" } else { line.ends_with(['{', ';', ',', '}']) && is_closed(line) }
    };
    let mut text = String::new();
    for (idx, line) in lines.iter().enumerate() {
        let code = line.trim();
        if !code.starts_with("//") && !code.starts_with('#') {
            text = format!("{text} {code}");
        }
        if ends(if is_whole { line } else { &text }) {
            return (text.trim().trim_end_matches(['{', ' ', ',']).to_owned(), idx + 1);
        }
    }
    panic!("no end: {}", lines[0]);
}

/// Checks that every parenthesis, and every brace of a grouped import, is closed.
fn is_closed(text: &str) -> bool {
    let count = |c: char| text.matches(c).count();
    let is_import = text.trim_start().starts_with("pub use");
    count('(') == count(')') && count('[') == count(']') && (!is_import || count('{') == count('}'))
}

/// The public items of the crate whose sources are below `sources`.
fn public_api(sources: &str) -> String {
    let is_source = |file: &&std::path::PathBuf| {
        file.starts_with(sources) && file.extension().is_some_and(|it| it == "rs")
    };
    let listed = |file: &Path| {
        let items = items(&fs::read_to_string(workspace().join(file)).unwrap());
        let name = file.strip_prefix(sources).unwrap().display().to_string();
        if items.is_empty() {
            String::new()
        } else {
            format!("{name}\n    {}\n\n", items.join("\n    "))
        }
    };
    project_files().iter().filter(is_source).map(|file| listed(file)).collect()
}

#[test]
fn declarations_are_found_with_their_owner_and_without_bodies_and_tests() {
    let source = "//! Doc.\n#[cfg(feature = \"x\")]\npub mod a;\n\n/// Doc.\npub struct B {\n    /// Doc.\n    pub c: f32, // no\n}\n\
        impl B {\n    pub fn d(\n        &self,\n    ) -> [f32; 2] {\n        pub_call()\n    }\n}\npub enum E {\n    /// Doc.\n    F,\n}\n\
        pub(crate) fn g() {}\n#[cfg(test)]\nmod tests {\n    pub fn h() {}\n}\n";
    let expected = [
        "#[cfg(feature = \"x\")] pub mod a;",
        "pub struct B",
        "pub c: f32",
        "impl B: pub fn d( &self, ) -> [f32; 2]",
    ];
    let found = items(source);
    assert_eq!(found[..4], expected);
    assert_eq!(found[4..], ["pub enum E { F, }"]);
}

#[track_caller]
fn assert_listed(sources: &str, golden: &str) {
    let (golden, found) = (workspace().join(golden), public_api(sources));
    if std::env::var_os(RENEW).is_some() {
        fs::write(&golden, &found).unwrap();
    }
    let listed = fs::read_to_string(&golden).unwrap();
    let added: Vec<_> =
        found.lines().filter(|line| !listed.lines().any(|other| other == *line)).collect();
    let gone: Vec<_> =
        listed.lines().filter(|line| !found.lines().any(|other| other == *line)).collect();
    assert!(
        listed == found,
        "LPR_RENEW_GOLDEN=1 with this test lists it anew. New: {added:#?}, gone: {gone:#?}"
    );
}

#[test]
fn the_public_api_of_the_core_is_the_listed_one() {
    assert_listed("lpr-core/src", "tests/golden/public-api.txt");
}

#[test]
fn the_public_api_of_the_arm_is_the_listed_one() {
    assert_listed("lpr-server/xarm/src", "tests/golden/public-api-xarm.txt");
}
