//! The documents: every command is one, every link and every named path leads somewhere.
//!
//! `tests/docs_long.sh` (`make docs-long`) runs the commands that are only read here.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

mod markdown;
mod shell;

use crate::lpr;
use lpr_tests::{output_of, project_files, workspace};
use markdown::Line;
use serde_json::Value;
use std::path::{Path, PathBuf};

/// Most lines of a document that is read in one go.
const MOST_LINES: [(&str, usize); 2] = [("README.md", 120), ("ARCHITECTURE.md", 200)];

/// Words that stand for a value in the commands within sentences, with a value.
const PLACEHOLDERS: [(&str, &str); 14] = [
    ("TASK", "open_drawer"),
    ("WHAT", "planning"),
    ("DIR", "runs/lid"),
    ("FILE", "problems.json"),
    ("PORT", "8081"),
    ("R", "panda"),
    ("M", "random"),
    ("K", "0"),
    ("N", "1"),
    ("S", "0"),
    ("V", "0"),
    ("FILE.urdf", "arm.urdf"),
    ("ARM.urdf", "arm.urdf"),
    ("ARM.srdf", "arm.srdf"),
];

/// A document of the project with its text.
struct Document {
    path: PathBuf,
    text: String,
}

impl Document {
    fn read(path: impl Into<PathBuf>) -> Self {
        let path = path.into();
        let text = std::fs::read_to_string(workspace().join(&path)).unwrap();
        Self { path, text }
    }

    /// Place of a line, for a message.
    fn at(&self, line: usize) -> String {
        format!("{}:{line}", self.path.display())
    }
}

/// All Markdown files.
fn documents() -> Vec<Document> {
    let is_markdown = |path: &PathBuf| path.extension().is_some_and(|it| it == "md");
    project_files().into_iter().filter(is_markdown).map(Document::read).collect()
}

/// The documents whose commands a reader types: README, book and the crates' READMEs.
fn guides() -> Vec<Document> {
    let mut guides = documents();
    guides.retain(|it| it.path.starts_with("docs") || it.path.ends_with("README.md"));
    assert!(guides.len() > 10, "the book is missing");
    guides
}

/// Fails with every complaint.
#[track_caller]
fn assert_none(complaints: &[String]) {
    assert!(complaints.is_empty(), "{complaints:#?}");
}

/// Completeness of a command in a document.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Extent {
    /// All of it, as it is typed.
    Whole,
    /// The subject of a sentence; required arguments may be missing.
    Mention,
}

/// The reason for which the command line refuses `arguments`, if it does.
fn refused_by_the_command_line(arguments: &[String]) -> Option<String> {
    let words = core::iter::once("lpr").chain(arguments.iter().map(String::as_str));
    lpr_server::cli::check_command_line(words).err()
}

/// The command, option or value that the command line does not know, if there is one.
///
/// With `--help` at the end, all of them are read and nothing runs.
fn unknown_to_the_command_line(arguments: &[String]) -> Option<String> {
    let asks_for_help = arguments.first().is_some_and(|word| word == "help");
    let help = (!asks_for_help).then(|| "--help".to_owned());
    let arguments: Vec<_> = arguments.iter().cloned().chain(help).collect();
    let output = lpr::command(&arguments).output().unwrap();
    (!output.status.success()).then(|| lpr::text(&output.stderr).trim().to_owned())
}

/// The reason for which a command cannot be run, if there is one.
fn fault(words: &[String], extent: Extent) -> Option<String> {
    let missing = |file: String| (!workspace().join(&file).exists()).then(|| format!("no {file}"));
    let words: Vec<_> = words.iter().map(String::as_str).collect();
    match words.as_slice() {
        ["lpr", arguments @ ..]
        | ["cargo", "run", "--release", "--", arguments @ ..]
        | ["cargo", "run", "--release", "--locked", "--", arguments @ ..] => {
            let arguments: Vec<_> = arguments.iter().map(|&it| it.to_owned()).collect();
            match extent {
                Extent::Whole => refused_by_the_command_line(&arguments),
                Extent::Mention => unknown_to_the_command_line(&arguments),
            }
        }
        ["cargo", "run", .., "--example", example] => {
            missing(format!("lpr-core/examples/{example}.rs"))
        }
        ["cargo", "build" | "test", "--locked", "-p", package] => {
            let lock = std::fs::read_to_string(workspace().join("Cargo.lock")).unwrap();
            let name = format!("name = \"{package}\"\n");
            (!lock.contains(&name)).then(|| format!("no package {package}"))
        }
        ["make", target] => (!has_target(target)).then(|| format!("no target {target}")),
        ["curl", options @ ..] => fault_of_request(options),
        ["cat", ">", _, "<<EOF"] | ["kill", "%1"] => None,
        [script, ..] if script.ends_with(".sh") => missing((*script).to_owned()),
        _ => Some("not a program that these tests know".to_owned()),
    }
}

fn has_target(target: &str) -> bool {
    let makefile = Document::read("Makefile");
    makefile.text.lines().any(|line| {
        line.split_once(':').is_some_and(|(targets, rest)| {
            !rest.starts_with('=') && targets.split(' ').any(|it| it == target)
        })
    })
}

/// The reason for which the API has no such request.
fn fault_of_request(options: &[&str]) -> Option<String> {
    let after = |option: &str| {
        options.iter().position(|it| *it == option).and_then(|at| options.get(at + 1)).copied()
    };
    let method = after("-X").unwrap_or(if after("-d").is_some() { "POST" } else { "GET" });
    let Some((_, path)) = options.iter().find_map(|it| it.split_once("127.0.0.1:8080/")) else {
        return Some("no address of the server".to_owned());
    };
    let api: Value =
        serde_json::from_str(&Document::read("tests/golden/openapi.json").text).unwrap();
    let fits = |template: &str| {
        let (template, path) = (template.trim_start_matches('/').split('/'), path.split('/'));
        template.clone().count() == path.clone().count()
            && template.zip(path).all(|(part, word)| part.starts_with('{') || part == word)
    };
    let known =
        api["paths"].as_object().unwrap().iter().any(|(template, methods)| {
            fits(template) && methods.get(method.to_lowercase()).is_some()
        });
    (!known).then(|| format!("the API has no {method} /{path}"))
}

#[test]
fn a_command_with_a_mistake_is_noticed() {
    for (line, complaint) in [
        ("lpr train take_lid_off_saucepan --outt runs/lid", "--outt"),
        ("lpr train take_the_lid_off --out runs/lid", "take_the_lid_off"),
        ("cargo run --release -- tusks", "tusks"),
        ("make chess", "no target chess"),
        ("curl -s -X POST 127.0.0.1:8080/v1/tasks", "no POST /v1/tasks"),
        ("curl -s 127.0.0.1:8080/v1/jobs/ID/end", "no GET /v1/jobs/ID/end"),
        ("cargo run -p lpr-core --example no_such", "no_such.rs"),
        ("wget x", "not a program"),
    ] {
        let found = fault(&shell::words(line), Extent::Whole);
        assert!(found.as_ref().is_some_and(|it| it.contains(complaint)), "{line}: {found:?}");
    }
    let request = shell::words("curl -s 127.0.0.1:8080/v1/jobs/ID/metrics");
    assert_eq!(fault(&request, Extent::Whole), None);
    assert_eq!(fault(&shell::words("lpr train"), Extent::Mention), None);
}

#[test]
fn every_command_in_a_block_can_be_run() {
    let mut complaints = Vec::new();
    for guide in guides() {
        for command in shell::commands(&markdown::fenced(&guide.text, "sh")) {
            complaints
                .extend(fault(&command.words, Extent::Whole).map(|why| {
                    format!("{}: {:?}: {why}", guide.at(command.number), command.words)
                }));
        }
    }
    assert_none(&complaints);
}

#[test]
fn every_command_within_a_sentence_can_be_run() {
    let mut complaints = Vec::new();
    // These two tell what was at a commit.
    let is_history = |it: &Document| {
        ["BENCHMARKS.md", "CHANGELOG.md"].iter().any(|path| it.path == Path::new(path))
    };
    for document in documents().iter().filter(|it| !is_history(it)) {
        for line in markdown::prose(&document.text) {
            let codes = markdown::inline_code(line.text).filter(|code| !code.contains('…'));
            for code in codes {
                let words = with_values(code);
                let is_command = matches!(words[..], [ref first, _, ..] if
                    first == "lpr" || first == "make" || code.starts_with("cargo run --release --"));
                if let Some(why) = is_command.then(|| fault(&words, Extent::Mention)).flatten() {
                    complaints.push(format!("{}: `{code}`: {why}", document.at(line.number)));
                }
            }
        }
    }
    assert_none(&complaints);
}

/// The words of a command with values for its placeholders, what is optional included.
fn with_values(code: &str) -> Vec<String> {
    let value = |word: &String| {
        let found = PLACEHOLDERS.iter().find(|(placeholder, _)| placeholder == word);
        found.map_or(word.clone(), |(_, value)| (*value).to_owned())
    };
    shell::words(&code.replace(['[', ']'], "")).iter().map(value).collect()
}

#[test]
fn the_long_test_runs_the_commands_that_are_read_here() {
    let listed = output_of("tests/docs_long.sh", &["--list"]);
    let mut listed: Vec<_> = listed.lines().collect();
    let guides = guides();
    let mut read: Vec<_> = guides
        .iter()
        .flat_map(|guide| markdown::fenced(&guide.text, "sh"))
        .map(|line| line.text)
        .collect();
    listed.sort_unstable();
    read.sort_unstable();
    assert_eq!(listed, read);
}

#[test]
fn every_link_leads_somewhere() {
    let mut complaints = Vec::new();
    for document in documents() {
        for line in markdown::prose(&document.text) {
            for link in markdown::links(line.text) {
                let why = fault_of_link(&document, &link);
                complaints.extend(why.map(|why| format!("{}: {why}", document.at(line.number))));
            }
        }
    }
    assert_none(&complaints);
}

/// The reason for which a link leads nowhere. Links to other sites are not followed.
fn fault_of_link(document: &Document, link: &str) -> Option<String> {
    if link.starts_with("https://") {
        return None;
    }
    let (file, anchor) = link.split_once('#').unwrap_or((link, ""));
    let folder = document.path.parent().unwrap();
    let target = match file {
        "" => document.path.clone(),
        file => folder.join(file),
    };
    if !workspace().join(&target).exists() {
        return Some(format!("{link}: no such file"));
    }
    if document.path.starts_with("docs") && file.starts_with("..") {
        return Some(format!("{link}: the book is read without the rest of the project"));
    }
    let has_anchor =
        || markdown::anchors(&Document::read(&target).text).iter().any(|it| it == anchor);
    (!anchor.is_empty() && !has_anchor()).then(|| format!("{link}: no such heading"))
}

#[test]
fn the_book_has_every_page_of_its_folder() {
    let summary = Document::read("docs/SUMMARY.md");
    let listed: Vec<_> = summary
        .text
        .lines()
        .flat_map(markdown::links)
        .map(|it| Path::new("docs").join(it))
        .collect();
    let mut pages = documents();
    pages.retain(|it| it.path.starts_with("docs") && it.path != summary.path);
    let lost: Vec<_> =
        pages.iter().map(|it| &it.path).filter(|path| !listed.contains(path)).collect();
    assert!(lost.is_empty(), "not in docs/SUMMARY.md: {lost:?}");
}

#[test]
fn documents_are_short() {
    for (path, most) in MOST_LINES {
        let lines = Document::read(path).text.lines().count();
        assert!(lines <= most, "{path}: expected at most {most} lines, found {lines}");
    }
}

#[test]
fn every_path_that_the_architecture_names_exists() {
    let document = Document::read("ARCHITECTURE.md");
    let complaints: Vec<_> = markdown::prose(&document.text)
        .iter()
        .flat_map(|line| {
            lost_paths(line).into_iter().map(|lost| format!("{}: {lost}", document.at(line.number)))
        })
        .collect();
    assert_none(&complaints);
}

/// The paths in a line that do not exist. After a path from the root, others may be given from it
/// or from its folder.
fn lost_paths<'a>(line: &Line<'a>) -> Vec<&'a str> {
    let is_path = |code: &&str| {
        (code.contains('/') || code.ends_with(".rs"))
            && code.chars().all(|c| c.is_ascii_alphanumeric() || "/._-".contains(c))
            && !code.starts_with('/')
    };
    let root = workspace();
    let mut near = Vec::new();
    let mut lost = Vec::new();
    for path in markdown::inline_code(line.text).filter(is_path) {
        if root.join(path).exists() {
            let whole = root.join(path);
            near = vec![whole.parent().unwrap().to_owned(), whole.with_extension(""), whole];
        } else if !near.iter().any(|folder| folder.join(path).exists()) {
            lost.push(path);
        }
    }
    lost
}

#[test]
fn a_path_may_be_given_from_the_one_before() {
    let lost = |text| lost_paths(&Line { number: 1, text });
    assert!(lost("`lpr-core/src/` has `lib.rs` and `GET /v1/x`, `a / b`").is_empty());
    assert!(lost("`lpr-core/src/lib.rs`, beside it `error.rs`").is_empty());
    assert_eq!(lost("`lib.rs`, `lpr-core/src/no.rs`"), ["lib.rs", "lpr-core/src/no.rs"]);
}

#[test]
fn the_messages_in_headings_of_troubleshooting_are_the_programs_own() {
    let mut files = project_files();
    files.retain(|path| path.extension().is_none_or(|extension| extension != "md"));
    let read = |path| std::fs::read_to_string(workspace().join(path)).ok();
    let sources: Vec<_> = files.into_iter().filter_map(read).collect();
    let document = Document::read("docs/troubleshooting.md");
    let mut complaints = Vec::new();
    for line in markdown::prose(&document.text).iter().filter(|it| it.text.starts_with('#')) {
        // Three dots stand for what differs from case to case.
        let fragments = line.text.split('"').skip(1).step_by(2).flat_map(|it| it.split('…'));
        for fragment in fragments.map(str::trim).filter(|it| !it.is_empty()) {
            if !sources.iter().any(|source| source.contains(fragment)) {
                complaints.push(format!("{}: {fragment:?}", document.at(line.number)));
            }
        }
    }
    assert_none(&complaints);
}

#[test]
fn the_program_of_the_library_page_is_a_test_of_the_library() {
    let page = Document::read("docs/library.md");
    let program: String = markdown::fenced(&page.text, "rust")
        .iter()
        .map(|line| format!("//! {}\n", line.text))
        .collect();
    let program = program.replace("//! \n", "//!\n");
    let module = Document::read("lpr-core/src/sim.rs");
    assert!(
        program.lines().count() > 5 && module.text.contains(&program),
        "{}: expected the program at the top of {}",
        page.path.display(),
        module.path.display()
    );
}
