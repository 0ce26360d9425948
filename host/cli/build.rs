//! Takes along the firmware that `RCG_UF2` names, for `rcg controller update`; nothing where it names none.

use std::path::PathBuf;
use std::{env, fs};

fn main() {
    println!("cargo:rerun-if-changed=build.rs");
    println!("cargo:rerun-if-env-changed=RCG_UF2");
    let out = PathBuf::from(env::var_os("OUT_DIR").expect("cargo sets OUT_DIR")).join("carried.uf2");
    let carried = match env::var_os("RCG_UF2").filter(|path| !path.is_empty()) {
        None => Vec::new(),
        Some(path) => {
            let path = PathBuf::from(path);
            println!("cargo:rerun-if-changed={}", path.display());
            match fs::read(&path) {
                Ok(bytes) if !bytes.is_empty() => bytes,
                found => {
                    let found = found.map_or_else(|error| error.to_string(), |_| "an empty file".to_owned());
                    println!(
                        "cargo::error=RCG_UF2: {}: expected a UF2 file, found: {found}",
                        path.display()
                    );
                    return;
                }
            }
        }
    };
    fs::write(out, carried).expect("cargo's own folder can be written");
}
