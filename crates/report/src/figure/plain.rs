//! The style sheet of figures without variables. Programs that turn SVG into PDF or PNG for papers (librsvg, Inkscape,
//! resvg) do not know them, and would draw in black.

/// The rules in the light colours, each variable replaced by its value.
pub(super) fn resolved(sheet: &str) -> String {
    let rules: Vec<(&str, &str)> = sheet.lines().filter(|line| !line.starts_with('@')).filter_map(rule).collect();
    let palette: Vec<(&str, &str)> = rules
        .first()
        .into_iter()
        .flat_map(|(_, body)| declarations(body))
        .filter(|(name, _)| name.starts_with("--"))
        .collect();
    let value = |text: &str| match text.strip_prefix("var(").and_then(|rest| rest.strip_suffix(')')) {
        Some(name) => palette.iter().find(|(known, _)| *known == name).map(|(_, value)| (*value).to_owned()),
        None => Some(text.to_owned()),
    };
    // Classes that say which colour `--c` is.
    let colours: Vec<(&str, String)> = (rules.iter())
        .flat_map(|(selectors, body)| selectors.split(',').map(move |selector| (selector, *body)))
        .filter_map(|(selector, body)| {
            let (_, colour) = declarations(body).find(|(name, _)| *name == "--c")?;
            Some((selector.rsplit(' ').next()?, value(colour)?))
        })
        .collect();
    let mut out = String::new();
    for (selectors, body) in &rules {
        for (name, text) in declarations(body).filter(|(name, _)| !name.starts_with("--")) {
            if text == "var(--c)" {
                let one = |(class, colour): &(&str, String)| format!("{selectors}{class}{{{name}:{colour}}}\n");
                out.extend(colours.iter().map(one));
            } else if let Some(value) = value(text) {
                out.push_str(&format!("{selectors}{{{name}:{value}}}\n"));
            }
        }
    }
    out
}

fn rule(line: &str) -> Option<(&str, &str)> {
    line.strip_suffix('}')?.split_once('{')
}

fn declarations(body: &str) -> impl Iterator<Item = (&str, &str)> {
    body.split(';').filter_map(|declaration| declaration.split_once(':'))
}

#[cfg(test)]
mod tests {
    use super::resolved;

    #[test]
    fn every_colour_is_plain() {
        let plain = resolved(crate::figure::STYLE);
        assert!(!plain.contains("--") && !plain.contains('@'), "{plain}");
        for rule in [
            "svg.figure .line.s0{stroke:#1f5fae}",
            "svg.figure .bar.k1{fill:#c2560c}",
            "svg.figure .cell{fill:#1f5fae}",
        ] {
            assert!(plain.contains(rule), "{rule} is not in {plain}");
        }
    }
}
