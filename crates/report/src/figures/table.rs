//! The paper beside ours.

/// One number of the paper and ours.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ComparisonRow {
    /// Where in the paper: `Fig. 10`.
    pub place: String,
    /// What is compared, with its unit.
    pub quantity: String,
    /// The paper's number or words; empty if it gives none.
    pub paper: String,
    /// Ours, with its spread and `n`.
    pub ours: String,
}

/// The table with which `reproduce all` ends.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct ComparisonTable {
    /// Rows in order.
    pub rows: Vec<ComparisonRow>,
}

impl ComparisonTable {
    /// The table as Markdown, columns aligned.
    ///
    /// ```
    /// use stridemap_report::figures::{ComparisonRow, ComparisonTable};
    /// let table = ComparisonTable { rows: vec![ComparisonRow {
    ///     place: "Fig. 10".into(), quantity: "fixed point (deg)".into(),
    ///     paper: "2.3".into(), ours: "2.03 (n = 20)".into(),
    /// }] };
    /// assert_eq!(table.markdown(), "\
    /// | place   | quantity          | paper | ours          |
    /// |---------|-------------------|-------|---------------|
    /// | Fig. 10 | fixed point (deg) | 2.3   | 2.03 (n = 20) |
    /// ");
    /// ```
    #[must_use]
    pub fn markdown(&self) -> String {
        let cell = |text: &str| text.replace('|', "\\|").replace('\n', " ");
        let mut rows: Vec<[String; 4]> = vec![["place", "quantity", "paper", "ours"].map(str::to_owned)];
        for r in &self.rows {
            rows.push([cell(&r.place), cell(&r.quantity), cell(&r.paper), cell(&r.ours)]);
        }
        let width = |c: usize| rows.iter().map(|r| r[c].chars().count()).max().unwrap_or(0);
        let widths = [0, 1, 2, 3].map(width);
        let mut out = String::new();
        for (i, row) in rows.iter().enumerate() {
            for (text, width) in row.iter().zip(widths) {
                out.push_str(&format!("| {text:<width$} "));
            }
            out.push_str("|\n");
            if i == 0 {
                for width in widths {
                    out.push_str(&format!("|{}", "-".repeat(width + 2)));
                }
                out.push_str("|\n");
            }
        }
        out
    }

    /// The table as CSV.
    #[must_use]
    pub fn csv(&self) -> String {
        let quote = |text: &str| format!("\"{}\"", text.replace('"', "\"\""));
        let mut out = String::from("place,quantity,paper,ours\n");
        for r in &self.rows {
            let cells = [&r.place, &r.quantity, &r.paper, &r.ours].map(|t| quote(t));
            out.push_str(&(cells.join(",") + "\n"));
        }
        out
    }
}
