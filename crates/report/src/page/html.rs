//! Tables, lists and marked-up text of a page.

use crate::draw::escape;

/// A column of a table: its head as HTML, and whether it holds numbers.
pub(super) type Column<'a> = (&'a str, bool);

/// A table of cells as HTML, which scrolls sideways where the page is narrow.
pub(super) fn table(columns: &[Column<'_>], rows: &[Vec<String>]) -> String {
    let line = |tag: &str, cells: &mut dyn Iterator<Item = &str>| -> String {
        let cell = |(text, (_, number)): (&str, &Column<'_>)| {
            format!("<{tag}{}>{text}</{tag}>", if *number { " class=\"num\"" } else { "" })
        };
        format!("<tr>{}</tr>", cells.zip(columns).map(cell).collect::<String>())
    };
    let head = line("th", &mut columns.iter().map(|c| c.0));
    let body: String = rows.iter().map(|row| line("td", &mut row.iter().map(String::as_str))).collect();
    format!("<div class=\"wide\"><table><thead>{head}</thead><tbody>{body}</tbody></table></div>")
}

/// Sentences, the bad ones marked; nothing without any.
pub(super) fn says(sentences: &[(bool, String)]) -> String {
    if sentences.is_empty() {
        return String::new();
    }
    let item = |(bad, text): &(bool, String)| {
        format!("<li{}>{}</li>", if *bad { " class=\"bad\"" } else { "" }, subscripts(text))
    };
    format!("<ul class=\"says\">{}</ul>", sentences.iter().map(item).collect::<String>())
}

/// Text with the subscripts of `ψ_roll` and `A_step` as HTML.
pub(super) fn subscripts(text: &str) -> String {
    let mut out = escape(text);
    for (name, sub) in [("ψ", "roll"), ("ψ", "pitch"), ("A", "step"), ("A", "walk"), ("A", "a,step")] {
        out = out.replace(&format!("{name}_{sub}"), &format!("{name}<sub>{sub}</sub>"));
    }
    out
}
