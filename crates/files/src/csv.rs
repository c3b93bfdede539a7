//! Comma-separated values by RFC 4180: the format of `eval/published` and of tables written as CSV.

/// Parses records of fields; the first is the header. A quoted field may contain commas, line ends and doubled quotes.
///
/// # Errors
/// The line, counted from 1, of an unterminated quote, of text after a closing quote, and of a record with a different
/// number of fields than the header.
pub fn parse(text: &str) -> Result<Vec<Vec<String>>, String> {
    let mut records: Vec<Vec<String>> = Vec::new();
    let (mut record, mut line) = (Vec::new(), 1);
    let mut rest = text;
    while !rest.is_empty() {
        let (field, after) = if let Some(quoted) = rest.strip_prefix('"') {
            let (field, after) = quoted_field(quoted)
                .ok_or_else(|| format!("line {line}: expected a closing quote, found the end of the file"))?;
            line += field.matches('\n').count();
            (field, after)
        } else {
            let end = rest.find([',', '\n']).unwrap_or(rest.len());
            let (field, after) = rest.split_at(end);
            (field.strip_suffix('\r').unwrap_or(field).to_owned(), after)
        };
        record.push(field);
        let after = after.strip_prefix("\r\n").map_or(after, |_| &after[1..]);
        if let Some(next) = after.strip_prefix(',') {
            rest = next;
            // A comma at the very end starts an empty field.
            if next.is_empty() {
                record.push(String::new());
            }
            continue;
        }
        rest = match after.strip_prefix('\n') {
            Some(next) => next,
            None if after.is_empty() => after,
            None => {
                return Err(format!(
                    "line {line}: expected a comma after a quoted field, found {:?}",
                    after.chars().next()
                ));
            }
        };
        end_record(&mut records, &mut record, line)?;
        line += 1;
    }
    if !record.is_empty() {
        end_record(&mut records, &mut record, line)?;
    }
    Ok(records)
}

/// A record with its line end; fields are quoted if necessary.
pub fn line(fields: &[String]) -> String {
    let written: Vec<String> = fields.iter().map(|field| quoted(field)).collect();
    format!("{}\n", written.join(","))
}

fn quoted(field: &str) -> String {
    let special = field.contains([',', '"', '\n', '\r']) || field.starts_with(' ') || field.ends_with(' ');
    if special { format!("\"{}\"", field.replace('"', "\"\"")) } else { field.to_owned() }
}

/// The text before the closing quote, and the rest after it.
fn quoted_field(text: &str) -> Option<(String, &str)> {
    let mut field = String::new();
    let mut rest = text;
    loop {
        let (before, after) = rest.split_once('"')?;
        field.push_str(before);
        match after.strip_prefix('"') {
            Some(next) => {
                field.push('"');
                rest = next;
            }
            None => return Some((field, after)),
        }
    }
}

fn end_record(records: &mut Vec<Vec<String>>, record: &mut Vec<String>, line: usize) -> Result<(), String> {
    let expected = records.first().map_or(record.len(), Vec::len);
    if record.len() != expected {
        return Err(format!("line {line}: expected {expected} fields, found {}", record.len()));
    }
    records.push(std::mem::take(record));
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn fields(record: &[&str]) -> Vec<String> {
        record.iter().map(|field| (*field).to_owned()).collect()
    }

    #[test]
    fn reads_back_what_it_wrote() {
        let record = fields(&["plain", "a, b", "say \"so\"", "two\nlines", "", " edge ", "\r", "é"]);
        let text = [line(&record), line(&record)].concat();
        assert_eq!(parse(&text).unwrap(), [record.clone(), record]);
    }

    #[test]
    fn reads_both_line_ends_and_empty_fields() {
        assert_eq!(parse("a,b\r\n1,\r\n").unwrap(), [fields(&["a", "b"]), fields(&["1", ""])]);
        assert_eq!(parse("a,b\n\"x\"\"y\",2").unwrap(), [fields(&["a", "b"]), fields(&["x\"y", "2"])]);
        assert_eq!(parse("a,b\n1,").unwrap(), [fields(&["a", "b"]), fields(&["1", ""])]);
        assert_eq!(parse("").unwrap(), Vec::<Vec<String>>::new());
    }

    #[test]
    fn errors_name_the_line() {
        for (text, line) in [
            ("a,b\n1\n", "line 2"),
            ("a\n\"1", "line 2"),
            ("a\n\"1\"2\n", "line 2"),
            ("a,b\n\"x\ny\",1\n2\n", "line 4"),
        ] {
            let error = parse(text).unwrap_err();
            assert!(error.contains(line), "{text:?}: {error}");
        }
    }
}
