use std::fs;

use super::*;

fn opening(began: &str, said: Said) -> Opening {
    let session = Session {
        began: began.to_owned(),
        command: "measure".to_owned(),
        program: "rcg".to_owned(),
        ..Session::default()
    };
    Opening::new(session, said).unwrap()
}

fn read(text: &str) -> Result<Said, String> {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("session.toml");
    fs::write(&path, text).unwrap();
    Said::read(&path).map_err(|error| {
        assert!(error.is_input());
        error.to_string()
    })
}

#[test]
fn a_session_says_what_it_may_and_nothing_else() {
    let all = "operator = \"A\"\nlaboratory = \"B\"\ntemperature_c = 21.12345\nhumidity_percent = 40\nnotes = [\"n\"]\n\
               attachments = [\"a.jpg\"]\n[instruments]\ncamera = \"1\"\nprojector = \"2\"\nmirror = \"3\"\ntrigger_box = \"4\"\n";
    let said = read(all).unwrap();
    assert_eq!(said.temperature_c, Some(21.123));
    assert_eq!(said.instruments.named().count(), 4);
    // From the folder of the file.
    assert!(said.attachments[0].is_absolute() && said.attachments[0].ends_with("a.jpg"));
    assert_eq!(read("").unwrap(), Said::default());
    for (text, part) in [
        ("operater = \"A\"", "operater"),
        ("[instruments]\nlamp = \"1\"", "instruments.lamp"),
        ("temperature_c = \"warm\"", "temperature_c"),
        (
            "temperature_c = 300",
            "temperature_c: expected a number from -50 to 100, found 300",
        ),
        ("temperature_c = nan", "temperature_c: expected a number"),
        (
            "humidity_percent = 101",
            "humidity_percent: expected a number from 0 to 100",
        ),
        ("operator = \"\"", "operator: expected some words"),
        ("notes = [\"a\", \"b\\nc\"]", "notes[1]: expected some words"),
        ("notes = \"a\"", "notes"),
        (
            "[instruments]\ntrigger_box = \" \"",
            "instruments.trigger_box: expected some words",
        ),
        ("operator = ", "line 1"),
    ] {
        let error = read(text).unwrap_err();
        assert!(error.contains(part) && !error.contains('\n'), "{text}: {error}");
    }
}

#[test]
fn a_later_session_changes_no_earlier_one_and_the_same_stands_there_once() {
    let dir = tempfile::tempdir().unwrap();
    assert_eq!(Record::read(dir.path()).unwrap(), None);
    let first = opening("2024-01-01T00:00:00Z", Said::default());
    first.note(dir.path()).unwrap();
    let before = fs::read(dir.path().join(Record::FILE)).unwrap();
    let sum = Record::read(dir.path()).unwrap().unwrap().first_sum();
    first.note(dir.path()).unwrap();
    assert_eq!(fs::read(dir.path().join(Record::FILE)).unwrap(), before);
    let said = Said {
        operator: Some("B".to_owned()),
        temperature_c: Some(21.1),
        ..Said::default()
    };
    let later = opening("2024-01-02T00:00:00Z", said);
    later.note(dir.path()).unwrap();
    let record = Record::read(dir.path()).unwrap().unwrap();
    assert_eq!(record.sessions, [first.session.clone(), later.session]);
    assert_eq!(record.first_sum(), sum);
    let facts = TriggerBoxFacts {
        port: "sim".to_owned(),
        ..TriggerBoxFacts::default()
    };
    for _ in 0..2 {
        Record::note_box(dir.path(), facts.clone()).unwrap();
    }
    assert_eq!(Record::read(dir.path()).unwrap().unwrap().trigger_boxes, [facts]);
}

#[test]
fn a_record_that_something_else_has_changed_is_refused() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join(Record::FILE);
    let said = Said {
        operator: Some("Ada".to_owned()),
        ..Said::default()
    };
    opening("2024-01-01T00:00:00Z", said).note(dir.path()).unwrap();
    let whole = fs::read_to_string(&path).unwrap();
    for (text, part) in [
        (whole.replace("Ada", "Eve"), "something else has changed"),
        (whole.replace("\"format\": 1", "\"format\": 2"), "format 2"),
        (whole.replace("Ada", "Ada\u{0}"), "no JSON object"),
        (whole[..whole.len() / 2].to_owned(), "no JSON object"),
        (whole.clone() + "\n", "something else has changed"),
        ("{}".to_owned(), "format null"),
    ] {
        fs::write(&path, &text).unwrap();
        let error = Record::read(dir.path()).unwrap_err();
        assert!(
            error.is_input() && error.to_string().contains(part),
            "{error}: {text}"
        );
    }
    fs::write(&path, whole).unwrap();
    Record::read(dir.path()).unwrap();
}

#[test]
fn attachments_are_copied_once_and_never_replaced() {
    let scratch = tempfile::tempdir().unwrap();
    let at = |name: &str| scratch.path().join(name);
    let dir = at("m");
    fs::create_dir(&dir).unwrap();
    fs::create_dir(at("other")).unwrap();
    fs::write(at("a.jpg"), "picture").unwrap();
    fs::write(at("other/A.JPG"), "another").unwrap();
    fs::write(at(".hidden"), "x").unwrap();
    let with = |paths: &[&str]| Said {
        attachments: paths.iter().map(|path| at(path)).collect(),
        ..Said::default()
    };
    let first = opening("2024-01-01T00:00:00Z", with(&["a.jpg"]));
    assert_eq!(first.session.attached[0].bytes, 7);
    first.note(&dir).unwrap();
    first.note(&dir).unwrap();
    assert_eq!(fs::read(dir.join("attachments/a.jpg")).unwrap(), b"picture");
    // The same name with another content.
    fs::write(at("a.jpg"), "changed").unwrap();
    let error = first.note(&at("other")).unwrap_err().to_string();
    assert!(error.contains("as it was at first"), "{error}");
    let later = opening("2024-01-02T00:00:00Z", with(&["a.jpg"]));
    let error = later.note(&dir).unwrap_err().to_string();
    assert!(error.contains("expected none yet of this name"), "{error}");
    assert_eq!(Record::read(&dir).unwrap().unwrap().sessions.len(), 1);
    let large = fs::File::create(at("large.png")).unwrap();
    large.set_len(LARGEST_BYTES + 1).unwrap();
    let many = vec!["a.jpg"; MOST + 1];
    for (paths, part) in [
        (&["none.jpg"][..], "none that can be read"),
        (&["m"], "something that is no file"),
        (&["large.png"], "at most 32 MiB, found 33554433 bytes"),
        (&["a.jpg", "other/A.JPG"], "different names"),
        (&[".hidden"], "does not begin with a dot"),
        (&many, "at most 20 attachments, found 21"),
    ] {
        let error = Opening::new(Session::default(), with(paths)).unwrap_err();
        assert!(error.is_input() && error.to_string().contains(part), "{error}");
    }
}
