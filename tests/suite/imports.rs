//! No module imports in a circle: every one can be read without those above it.
//!
//! The graph is of `use` lines and of paths that begin with `crate::` or `super::`, each followed
//! through re-exports to the file that defines the name. At every level of the tree the modules of
//! one folder must have an order. A parent and its own private children may use each other.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

use lpr_tests::{project_files, workspace};
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

/// A path of names: of a module below its crate, or of what a `use` line names.
type Names = Vec<String>;

/// One module file without its tests.
struct Module {
    text: String,
    /// Every imported path with the name that it has here.
    imports: Vec<Import>,
    public_children: BTreeSet<String>,
}

struct Import {
    path: Names,
    name: String,
    is_reexport: bool,
}

/// The modules of one crate by their path.
struct Crate(BTreeMap<Names, Module>);

fn names(path: &str) -> Names {
    path.split("::").map(|name| name.trim().to_owned()).collect()
}

/// Path of the module of a file below `src`; none for a binary's root, which nothing imports.
fn module_path(file: &Path) -> Option<Names> {
    let mut path: Names =
        file.with_extension("").iter().map(|part| part.to_str().unwrap().to_owned()).collect();
    match path.last()?.as_str() {
        "main" if path.len() == 1 => return None,
        "lib" if path.len() == 1 => path.clear(),
        "mod" => drop(path.pop()),
        _ => {}
    }
    Some(path)
}

impl Crate {
    fn read(src: &str) -> Self {
        let mut modules = BTreeMap::new();
        for file in project_files() {
            let Ok(below) = file.strip_prefix(src) else { continue };
            if below.extension().is_none_or(|it| it != "rs") {
                continue;
            }
            let Some(path) = module_path(below) else { continue };
            let text = code(&std::fs::read_to_string(workspace().join(&file)).unwrap());
            modules.insert(path, Module::new(text));
        }
        assert!(modules.len() > 1, "no modules below {src}");
        Self(without_tests(modules))
    }

    /// The module that defines the end of `path` as seen from `from`, if it is of this crate.
    fn definition(&self, from: &[String], path: &[String]) -> Option<Names> {
        let mut at: Names = from.to_vec();
        let mut rest = path;
        match rest.first()?.as_str() {
            "crate" => at.clear(),
            "self" => {}
            "super" => drop(at.pop()?),
            child => {
                at.push(child.to_owned());
                self.0.get(&at)?;
            }
        }
        rest = &rest[1..];
        while let Some(name) = rest.first() {
            if name == "super" {
                at.pop()?;
                rest = &rest[1..];
                continue;
            }
            let child: Names = at.iter().chain([name]).cloned().collect();
            if self.0.contains_key(&child) {
                at = child;
                rest = &rest[1..];
                continue;
            }
            let reexport = |import: &&Import| import.is_reexport && import.name == *name;
            let Some(import) = self.0.get(&at)?.imports.iter().find(reexport) else { break };
            return self.definition(&at, &import.path);
        }
        Some(at)
    }

    /// Every import: from which module, what, defined where.
    fn edges(&self) -> Vec<(&Names, String, Names)> {
        let edges = self.0.iter().flat_map(|(from, module)| {
            // A re-export is no use of its own: who imports it is followed through it.
            let used = module.imports.iter().filter(|import| !import.is_reexport);
            let used = used.map(|import| import.path.clone()).chain(inline_paths(&module.text));
            used.filter_map(move |path| {
                let to = self.definition(from, &path)?;
                Some((from, path.join("::"), to))
            })
        });
        edges.filter(|(from, _, to)| *from != to).collect()
    }

    /// Circles, each as a list of lines that name the imports which close it.
    fn circles(&self) -> Vec<Vec<String>> {
        // At each folder: which of its modules imports which other, with one example.
        let mut levels: BTreeMap<Names, BTreeMap<(String, String), String>> = BTreeMap::new();
        let mut circles = Vec::new();
        let edges = self.edges();
        for (from, what, to) in &edges {
            let shared = from.iter().zip(to).take_while(|(a, b)| a == b).count();
            let example = format!("{} imports {what}", from.join("::"));
            if let (Some(a), Some(b)) = (from.get(shared), to.get(shared)) {
                let level = levels.entry(from[..shared].to_vec()).or_default();
                level.entry((a.clone(), b.clone())).or_insert(example);
            } else if from.len() + 1 == to.len()
                && self.0[*from].public_children.contains(&to[shared])
                && edges.iter().any(|(back, _, of)| *back == to && of == *from)
            {
                circles.push(vec![example, format!("and {} imports back", to.join("::"))]);
            }
        }
        circles.extend(levels.values().filter_map(circle));
        circles
    }
}

impl Module {
    fn new(text: String) -> Self {
        let mut imports = Vec::new();
        let mut public_children = BTreeSet::new();
        for statement in text.split_inclusive(';') {
            // The statement begins after the last block or attribute before it.
            let line = statement.rsplit(['}', '{', ']']).next().unwrap_or(statement).trim();
            if let Some(child) = line.strip_prefix("pub mod ") {
                public_children.insert(child.trim_end_matches(';').to_owned());
            }
        }
        for (at, _) in text.match_indices("use ") {
            let line_start = text[..at].rfind('\n').map_or(0, |end| end + 1);
            let before = text[line_start..at].trim();
            if !(before.is_empty() || before.starts_with("pub")) {
                continue;
            }
            let Some(end) = text[at..].find(';') else { continue };
            let tree = &text[at + "use ".len()..at + end];
            flatten(tree, &mut Vec::new(), &mut |path, name| {
                imports.push(Import { path, name, is_reexport: !before.is_empty() });
            });
        }
        Self { text, imports, public_children }
    }
}

/// The paths of a `use` tree, each with the name that it is imported as.
fn flatten(tree: &str, prefix: &mut Names, found: &mut impl FnMut(Names, String)) {
    let tree = tree.trim();
    let depth = prefix.len();
    if let Some((head, group)) = tree.split_once('{') {
        prefix
            .extend(head.split("::").map(str::trim).filter(|it| !it.is_empty()).map(str::to_owned));
        let group = group.trim_end().strip_suffix('}').unwrap_or(group);
        let (mut start, mut nesting) = (0, 0);
        for (at, c) in group.char_indices() {
            match c {
                '{' => nesting += 1,
                '}' => nesting -= 1,
                ',' if nesting == 0 => {
                    flatten(&group[start..at], prefix, found);
                    start = at + 1;
                }
                _ => {}
            }
        }
        flatten(&group[start..], prefix, found);
    } else if !tree.is_empty() {
        let (path, alias) = tree.split_once(" as ").unwrap_or((tree, ""));
        prefix.extend(names(path).into_iter().filter(|name| name != "self" || depth == 0));
        let last = prefix.last().unwrap().clone();
        found(prefix.clone(), if alias.is_empty() { last } else { alias.trim().to_owned() });
    }
    prefix.truncate(depth);
}

/// Paths in the code itself that begin at the crate or at a parent.
fn inline_paths(text: &str) -> Vec<Names> {
    let is_path = |c: char| c.is_alphanumeric() || c == '_' || c == ':';
    let begins = |word: &&str| word.starts_with("crate::") || word.starts_with("super::");
    let words = text.split(|c| !is_path(c)).filter(begins);
    words.map(|word| names(word.trim_end_matches(':'))).collect()
}

/// The code of a file: without comments, strings' contents, and the tests at its end.
fn code(text: &str) -> String {
    let text = text.split("#[cfg(test)]\nmod tests {").next().unwrap_or_default();
    let strip = |line: &str| line.split("//").next().unwrap_or_default().to_owned();
    text.lines().map(strip).collect::<Vec<_>>().join("\n")
}

/// The modules but those that a parent declares for tests alone.
fn without_tests(modules: BTreeMap<Names, Module>) -> BTreeMap<Names, Module> {
    let is_test = |path: &Names| {
        (0..path.len()).any(|depth| {
            let parent = modules.get(&path[..depth]);
            parent.is_some_and(|parent| is_declared_for_tests(&parent.text, &path[depth]))
        })
    };
    let tests: BTreeSet<Names> = modules.keys().filter(|path| is_test(path)).cloned().collect();
    modules.into_iter().filter(|(path, _)| !tests.contains(path)).collect()
}

fn is_declared_for_tests(parent: &str, child: &str) -> bool {
    let lines: Vec<_> = parent.lines().map(str::trim).collect();
    lines.windows(2).any(|pair| {
        let is_test = pair[0] == "#[cfg(test)]" || pair[0].starts_with("#[cfg(all(test,");
        is_test && pair[1].ends_with(&format!("mod {child};"))
    })
}

/// One circle of a graph, as the examples of its edges.
fn circle(edges: &BTreeMap<(String, String), String>) -> Option<Vec<String>> {
    let mut left: BTreeSet<&String> = edges.keys().flat_map(|(a, b)| [a, b]).collect();
    // Whoever imports nothing that is left can be read next.
    loop {
        let ready =
            |module: &&&String| !edges.keys().any(|(a, b)| a == **module && left.contains(b));
        let Some(next) = left.iter().find(ready).copied() else { break };
        left.remove(next);
    }
    let mut at = *left.first()?;
    let mut way = Vec::new();
    while !way.contains(&at) {
        way.push(at);
        at = &edges.keys().find(|(a, b)| a == at && left.contains(b)).unwrap().1;
    }
    let start = way.iter().position(|module| *module == at).unwrap();
    let ring: Vec<_> = way[start..].iter().chain([&at]).copied().collect();
    Some(ring.windows(2).map(|pair| edges[&(pair[0].clone(), pair[1].clone())].clone()).collect())
}

#[track_caller]
fn assert_no_circles(src: &str) {
    let circles = Crate::read(src).circles();
    assert!(circles.is_empty(), "modules of {src} import in circles: {circles:#?}");
}

#[test]
fn modules_of_the_core_have_an_order() {
    assert_no_circles("lpr-core/src");
}

#[test]
fn modules_of_the_page_have_an_order() {
    assert_no_circles("lpr-wasm/src");
}

#[test]
fn modules_of_the_server_have_an_order() {
    assert_no_circles("lpr-server/src");
}

#[test]
fn modules_of_the_arm_have_an_order() {
    assert_no_circles("lpr-server/xarm/src");
}

fn tiny(files: &[(&str, &str)]) -> Crate {
    let module = |(path, text): &(&str, &str)| {
        let path = if path.is_empty() { Vec::new() } else { names(path) };
        (path, Module::new(code(text)))
    };
    Crate(without_tests(files.iter().map(module).collect()))
}

#[test]
fn circles_are_found_through_groups_reexports_and_paths_in_code() {
    let through_reexport = [
        ("", "mod a;\nmod b;\n"),
        ("a", "mod inner;\npub use inner::{Deep, other as Other};\n"),
        ("a::inner", "use crate::b::{self, Thing as _};\n"),
        ("b", "fn f() { let _ = crate::a::Deep; }\n"),
    ];
    assert_eq!(tiny(&through_reexport).circles().len(), 1);
    let between_siblings = [
        ("", "mod a;\n"),
        ("a", "mod x;\nmod y;\n"),
        ("a::x", "use super::y::Y;\n"),
        ("a::y", "use crate::{\n    a::x::X,\n};\n"),
    ];
    assert_eq!(tiny(&between_siblings).circles().len(), 1);
    let public_child = [("", "pub mod a;\nuse a::B;\n"), ("a", "use super::C;\n")];
    assert_eq!(tiny(&public_child).circles().len(), 1);
}

#[test]
fn parents_with_private_children_and_tests_are_no_circles() {
    let private_child = [("", "mod a;\nuse a::B;\n"), ("a", "use super::C;\n")];
    assert!(tiny(&private_child).circles().is_empty());
    let in_tests = [
        ("", "mod a;\nmod b;\n"),
        ("a", "use crate::b::B;\n"),
        ("b", "// use crate::a::A;\n#[cfg(test)]\nmod tests {\nuse crate::a::A;\n}\n"),
    ];
    assert!(tiny(&in_tests).circles().is_empty());
    let in_order = [("", "mod a;\nmod b;\n"), ("a", "use crate::b::B;\n"), ("b", "use std::fs;\n")];
    assert!(tiny(&in_order).circles().is_empty());
}
