//! Commands, links and headings of a Markdown file.

/// A line of a document with its number, from 1.
#[derive(Debug, Clone, Copy)]
pub(super) struct Line<'a> {
    pub(super) number: usize,
    pub(super) text: &'a str,
}

/// Lines inside the fenced blocks whose language is `language`.
pub(super) fn fenced<'a>(text: &'a str, language: &str) -> Vec<Line<'a>> {
    let mut lines = lines(text);
    lines.retain(|(block, _)| *block == Some(language));
    lines.into_iter().map(|(_, line)| line).collect()
}

/// Lines outside of all fenced blocks.
pub(super) fn prose(text: &str) -> Vec<Line<'_>> {
    let mut lines = lines(text);
    lines.retain(|(block, _)| block.is_none());
    lines.into_iter().map(|(_, line)| line).collect()
}

/// Lines without the fences themselves, each with the language of its block.
fn lines(text: &str) -> Vec<(Option<&str>, Line<'_>)> {
    let mut block = None;
    let mut found = Vec::new();
    for (idx, text) in text.lines().enumerate() {
        match (text.strip_prefix("```"), block) {
            (Some(language), None) => block = Some(language),
            (Some(_), Some(_)) => block = None,
            (None, _) => found.push((block, Line { number: idx + 1, text })),
        }
    }
    found
}

/// Inline code of a line.
pub(super) fn inline_code(line: &str) -> impl Iterator<Item = &str> {
    line.split('`').skip(1).step_by(2)
}

/// Targets of the links and pictures of a line.
pub(super) fn links(line: &str) -> Vec<String> {
    // A bracket inside of code is no link.
    let without_code: String = line.split('`').step_by(2).collect();
    let targets = without_code.split("](").skip(1);
    targets.filter_map(|rest| Some(rest.split_once(')')?.0.to_owned())).collect()
}

/// Anchors of the headings, as GitHub and mdBook make them.
pub(super) fn anchors(text: &str) -> Vec<String> {
    let headings = prose(text).into_iter().filter_map(|line| {
        let title = line.text.trim_start_matches('#');
        (title.len() < line.text.len()).then_some(title.strip_prefix(' ')?)
    });
    headings.map(anchor).collect()
}

fn anchor(title: &str) -> String {
    let kept = title.trim().chars().filter(|c| c.is_alphanumeric() || " -_".contains(*c));
    kept.map(|c| if c == ' ' { '-' } else { c }).flat_map(char::to_lowercase).collect()
}

#[test]
fn blocks_links_and_headings_are_found() {
    let text = "# A robot's `file`\n```sh\nlpr tasks\n```\nSee [a](b.md#c) and ![p](d.png), not `x](y)`.\n\
                ```rust\n# hidden\n```\n";
    assert_eq!(fenced(text, "sh").iter().map(|line| line.text).collect::<Vec<_>>(), ["lpr tasks"]);
    assert_eq!(fenced(text, "sh")[0].number, 3);
    assert_eq!(prose(text).len(), 2);
    assert_eq!(links(prose(text)[1].text), ["b.md#c", "d.png"]);
    assert_eq!(inline_code(prose(text)[1].text).collect::<Vec<_>>(), ["x](y)"]);
    assert_eq!(anchors(text), ["a-robots-file"]);
}
