//! The rules of `ARCHITECTURE.md` that a program can check.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

use lpr_tests::{project_files, workspace};
use std::path::{Path, PathBuf};

/// Longest Rust file, lines.
const MAX_LINES: usize = 600;

/// Folder in which lengths are millimetres.
const WIRE: &str = "lpr-server/xarm/src/wire";

/// One line of a source file without its comment.
struct Line {
    file: PathBuf,
    number: usize,
    code: String,
}

fn read(file: &Path) -> String {
    std::fs::read_to_string(workspace().join(file)).unwrap()
}

/// Lines of the Rust files below `folder`, except this file, which names what it forbids.
fn code_below(folder: &str) -> Vec<Line> {
    let is_ours = |file: &PathBuf| {
        file.starts_with(folder)
            && file.extension().is_some_and(|it| it == "rs")
            && !file.ends_with("suite/architecture.rs")
    };
    let lines: Vec<_> =
        project_files().into_iter().filter(is_ours).flat_map(|file| code_of(&file)).collect();
    assert!(!lines.is_empty(), "no Rust code below {folder}");
    lines
}

fn code_of(file: &Path) -> Vec<Line> {
    let code = |line: &str| line.split("//").next().unwrap_or_default().to_owned();
    let text = read(file);
    text.lines()
        .enumerate()
        .map(|(idx, line)| Line { file: file.to_owned(), number: idx + 1, code: code(line) })
        .collect()
}

/// Fails with every line in which one of `words` stands as a whole path or name.
#[track_caller]
fn assert_absent(lines: &[Line], words: &[&str]) {
    let found: Vec<_> = lines
        .iter()
        .flat_map(|line| {
            words.iter().filter(|word| has_word(&line.code, word)).map(move |word| (line, word))
        })
        .map(|(line, word)| format!("{}:{}: {word}", line.file.display(), line.number))
        .collect();
    assert!(found.is_empty(), "{found:#?}");
}

fn has_word(code: &str, word: &str) -> bool {
    let is_part = |c: char| c.is_alphanumeric() || c == '_';
    code.match_indices(word).any(|(at, _)| {
        !code[..at].chars().next_back().is_some_and(is_part)
            && !code[at + word.len()..].chars().next().is_some_and(is_part)
    })
}

#[test]
fn words_are_found_whole() {
    assert!(has_word("use std::fs;", "std::fs") && has_word("std::fs::read(a)", "std::fs"));
    assert!(!has_word("use std::fsync;", "std::fs") && !has_word("my_std::fs", "std::fs"));
}

#[test]
fn the_core_has_no_files_sockets_clock_or_threads_of_its_own() {
    let modules = ["env", "fs", "net", "process", "thread", "time"];
    let paths = modules.map(|module| format!("std::{module}"));
    let core = code_below("lpr-core/src");
    assert_absent(&core, &paths.each_ref().map(String::as_str));
    // The same modules in a grouped import.
    let grouped: Vec<_> =
        core.into_iter().filter(|line| line.code.contains("use std::{")).collect();
    assert_absent(&grouped, &modules);
}

#[test]
fn only_the_wire_knows_millimetres() {
    let lines: Vec<_> = code_below("lpr-server/xarm")
        .into_iter()
        .filter(|line| !line.file.starts_with(WIRE))
        .collect();
    assert_absent(&lines, &["millimetres", "mm", "to_degrees", "to_radians"]);
}

#[test]
fn every_module_is_where_its_name_says() {
    let found: Vec<_> = code_below("")
        .into_iter()
        .filter(|line| line.code.trim_start().starts_with("#[path"))
        .map(|line| format!("{}:{}", line.file.display(), line.number))
        .collect();
    assert!(found.is_empty(), "a file of another place is included at {found:?}");
}

#[test]
fn generators_are_made_in_one_place() {
    let mut lines = code_below("");
    lines.retain(|line| line.file != Path::new("lpr-core/src/rng.rs"));
    assert_absent(
        &lines,
        &["seed_from_u64", "from_seed", "from_rng", "from_os_rng", "try_from_os_rng"],
    );
    assert_absent(
        &lines,
        &[
            "rand::random",
            "rand::rng",
            "thread_rng",
            "ThreadRng",
            "StdRng",
            "SmallRng",
            "SysRng",
            "OsRng",
        ],
    );
}

#[test]
fn nothing_that_decides_a_candidate_is_fused() {
    for module in ["path", "perception", "robot", "scene"] {
        let lines = code_below(&format!("lpr-core/src/{module}"));
        assert_absent(&lines, &["mul_add"]);
        assert!(
            lines.iter().all(|line| !line.code.contains("fmadd")),
            "a fused intrinsic in {module}"
        );
    }
}

/// Files below `folder` whose code holds `call`, tests aside.
fn callers(call: &str) -> Vec<String> {
    let is_test = |file: &Path| {
        file.ends_with("tests.rs") || file.components().any(|part| part.as_os_str() == "tests")
    };
    let lines = code_below("").into_iter().filter(|line| !is_test(&line.file));
    let mut files: Vec<_> = lines
        .filter(|line| line.code.contains(call))
        .map(|line| line.file.display().to_string())
        .collect();
    files.dedup();
    files
}

/// "Look, choose a pose, act" stands in one function, which everything else calls.
#[test]
fn lines_6_to_12_of_algorithm_1_are_one_function() {
    assert_eq!(callers("self.goal(environment"), ["lpr-core/src/agent.rs"], "decide looks");
    assert_eq!(callers("self.act("), ["lpr-core/src/agent.rs"], "decide acts");
    assert!(callers("agent.goal(").is_empty(), "nobody else looks");
    // Those that are given a pose and have nothing to look for.
    let given = [
        "lpr-core/src/diagnose/ladder.rs",
        "lpr-core/src/diagnose/ranking.rs",
        "lpr-server/src/cli/bench.rs",
        "lpr-server/src/cli/paths.rs",
        "lpr-wasm/src/check.rs",
    ];
    assert_eq!(callers("agent.act("), given);
    let deciding = [
        "lpr-core/src/evaluate.rs",
        "lpr-core/src/train.rs",
        "lpr-server/src/cli/xarm/run.rs",
        "lpr-wasm/src/demo.rs",
    ];
    assert_eq!(callers("agent.decide("), deciding, "evaluation, training, arm and page decide");
    let executing = ["evaluate/best_of_all.rs", "evaluate/record.rs", "evaluate.rs", "train.rs"];
    assert_eq!(callers("agent.execute("), executing.map(|file| format!("lpr-core/src/{file}")));
    // The ladder runs paths of its own, the page records frames.
    let with = ["lpr-core/src/diagnose/ladder.rs", "lpr-wasm/src/demo.rs"];
    assert_eq!(callers("agent.execute_with("), with);
}

#[test]
fn files_are_short() {
    let too_long = |file: &PathBuf| {
        file.extension().is_some_and(|it| it == "rs") && read(file).lines().count() > MAX_LINES
    };
    let long: Vec<_> = project_files().into_iter().filter(too_long).collect();
    assert!(long.is_empty(), "over {MAX_LINES} lines: {long:?}");
}

#[test]
fn every_toml_file_parses() {
    let files: Vec<_> = project_files()
        .into_iter()
        .filter(|file| file.extension().is_some_and(|it| it == "toml"))
        .collect();
    assert!(files.contains(&PathBuf::from("Cargo.toml")));
    for file in files {
        let parsed: Result<toml::Table, _> = toml::from_str(&read(&file));
        assert!(parsed.is_ok(), "{}: {}", file.display(), parsed.unwrap_err());
    }
}

#[test]
fn no_file_names_a_place_on_one_machine() {
    let homes = ["farm", "home", "root", "Users", "work"].map(|folder| format!("/{folder}/"));
    let names_home = |line: &str| {
        homes.iter().any(|home| {
            // Part of a longer path or address otherwise.
            line.match_indices(home.as_str()).any(|(at, _)| {
                !line[..at].ends_with(|c: char| c.is_alphanumeric() || "._~-".contains(c))
            })
        })
    };
    assert!(
        names_home(&format!("see {}a", homes[0]))
            && !names_home(&format!("https://example.org{}a", homes[0]))
    );
    for file in project_files() {
        let Ok(text) = std::fs::read_to_string(workspace().join(&file)) else { continue };
        let found: Vec<_> = text.lines().filter(|line| names_home(line)).collect();
        assert!(found.is_empty(), "{}: {found:?}", file.display());
    }
}
