//! The little of a shell's language that documents use: one command a line, comments, quotes, files
//! in place (`<<'EOF'`) and commands in the background.

use super::markdown::Line;

/// A command of a document.
#[derive(Debug, PartialEq, Eq)]
pub(super) struct Command {
    /// Line of the document, from 1.
    pub(super) number: usize,
    pub(super) words: Vec<String>,
}

/// The commands of a block; the text of files in place is left out.
pub(super) fn commands(lines: &[Line<'_>]) -> Vec<Command> {
    let mut file_ends = None;
    let mut found = Vec::new();
    for line in lines {
        match file_ends {
            Some(end) if line.text == end => file_ends = None,
            Some(_) => {}
            None => {
                let words = words(line.text);
                file_ends = words.iter().any(|word| word == "<<EOF").then_some("EOF");
                if !words.is_empty() {
                    found.push(Command { number: line.number, words });
                }
            }
        }
    }
    found
}

/// The words of a command without its comment and its `&`, quotes taken off.
pub(super) fn words(line: &str) -> Vec<String> {
    let mut words = Vec::new();
    let mut word: Option<String> = None;
    let mut quote = None;
    for c in line.chars() {
        match (c, quote) {
            (c, Some(open)) if c == open => quote = None,
            ('\'' | '"', None) => {
                quote = Some(c);
                word.get_or_insert_default();
            }
            (' ', None) => words.extend(word.take()),
            ('#', None) if word.is_none() => break,
            _ => word.get_or_insert_default().push(c),
        }
    }
    words.extend(word);
    words.retain(|word| word != "&");
    words
}

#[test]
fn a_line_is_split_as_a_shell_does() {
    assert_eq!(words("curl -d '{\"a\": 1}' \"x y\" # why"), ["curl", "-d", "{\"a\": 1}", "x y"]);
    assert_eq!(words("lpr serve &"), ["lpr", "serve"]);
    assert!(words("# nothing").is_empty() && words("").is_empty());
    let lines = ["cat > a <<'EOF'", "lpr no-command", "EOF", "lpr tasks"];
    let lines: Vec<_> = lines.iter().map(|&text| Line { number: 1, text }).collect();
    let found = commands(&lines);
    assert_eq!(found.len(), 2, "{found:?}");
    assert_eq!(found[1].words, ["lpr", "tasks"]);
}
