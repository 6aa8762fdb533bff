//! What ends up in a build: the resolved packages, the policy of `deny.toml`, and a bill of materials.
//!
//! Cargo's own metadata is the only source, so nothing has to be installed for it. Advisories need a database and are
//! cargo-deny's (`cargo xtask supply-chain`).

use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::Command;

/// The repository's root.
pub fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

/// Cargo's metadata for the host and the node's target, from the locked versions.
///
/// # Errors
/// What cargo complains about: a lock file that does not fit above all.
pub fn metadata() -> Result<Value, String> {
    let output = Command::new(std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into()))
        .args(["metadata", "--format-version", "1", "--locked"])
        .args(["--filter-platform", "x86_64-unknown-linux-gnu", "--filter-platform", "thumbv7em-none-eabihf"])
        .current_dir(root())
        .output()
        .map_err(|error| format!("cargo metadata: {error}"))?;
    if !output.status.success() {
        return Err(format!("cargo metadata: {}", String::from_utf8_lossy(&output.stderr)));
    }
    serde_json::from_slice(&output.stdout).map_err(|error| format!("cargo metadata: {error}"))
}

/// Checksums of `Cargo.lock` by name and version.
///
/// # Errors
/// A lock file that cannot be read.
pub fn checksums() -> Result<BTreeMap<(String, String), String>, String> {
    let path = root().join("Cargo.lock");
    let text = std::fs::read_to_string(&path).map_err(|error| format!("{}: {error}", path.display()))?;
    let lock: toml::Table = text.parse().map_err(|error| format!("{}: {error}", path.display()))?;
    let packages = lock.get("package").and_then(toml::Value::as_array).ok_or("Cargo.lock has no packages")?;
    let word = |package: &toml::Value, key: &str| package.get(key).and_then(toml::Value::as_str).map(str::to_owned);
    Ok(packages
        .iter()
        .filter_map(|package| Some(((word(package, "name")?, word(package, "version")?), word(package, "checksum")?)))
        .collect())
}

/// Licences that `deny.toml` allows.
///
/// # Errors
/// A policy that cannot be read.
pub fn allowed_licences() -> Result<Vec<String>, String> {
    let path = root().join("deny.toml");
    let text = std::fs::read_to_string(&path).map_err(|error| format!("{}: {error}", path.display()))?;
    let policy: toml::Table = text.parse().map_err(|error| format!("{}: {error}", path.display()))?;
    let allow = policy.get("licenses").and_then(|l| l.get("allow")).and_then(toml::Value::as_array);
    let allow = allow.ok_or("deny.toml has no list of licences")?;
    Ok(allow.iter().filter_map(|licence| licence.as_str().map(str::to_owned)).collect())
}

/// A bill of materials in CycloneDX 1.5.
///
/// # Errors
/// Metadata without packages, or a package from a registry that the lock file has no checksum of.
pub fn bill_of_materials(metadata: &Value, checksums: &BTreeMap<(String, String), String>) -> Result<Value, String> {
    let packages = metadata["packages"].as_array().ok_or("the metadata has no packages")?;
    let text = |value: &Value| value.as_str().unwrap_or_default().to_owned();
    let mut components = Vec::new();
    for package in packages {
        let (name, version) = (text(&package["name"]), text(&package["version"]));
        let reference = format!("pkg:cargo/{name}@{version}");
        let mut component = json!({
            "type": "library", "bom-ref": reference, "name": name, "version": version, "purl": reference,
            "licenses": [{ "expression": text(&package["license"]).replace('/', " OR ") }],
        });
        if package["source"].is_string() {
            let sum = checksums.get(&(name.clone(), version)).ok_or(format!("{name}: no checksum is locked"))?;
            component["hashes"] = json!([{ "alg": "SHA-256", "content": sum }]);
        }
        components.push(component);
    }
    components.sort_by_key(|component| text(&component["bom-ref"]));
    let identity: BTreeMap<String, String> = packages
        .iter()
        .map(|p| (text(&p["id"]), format!("pkg:cargo/{}@{}", text(&p["name"]), text(&p["version"]))))
        .collect();
    let nodes = metadata["resolve"]["nodes"].as_array().ok_or("the metadata has no resolution")?;
    let mut dependencies: Vec<Value> = nodes
        .iter()
        .map(|node| {
            let depends = node["dependencies"].as_array().into_iter().flatten();
            let mut on: Vec<&String> = depends.filter_map(|id| identity.get(id.as_str()?)).collect();
            on.sort();
            json!({ "ref": identity.get(&text(&node["id"])), "dependsOn": on })
        })
        .collect();
    dependencies.sort_by_key(|entry| text(&entry["ref"]));
    let version = env!("CARGO_PKG_VERSION");
    Ok(json!({
        "bomFormat": "CycloneDX", "specVersion": "1.5", "version": 1,
        "metadata": { "component": { "type": "application", "name": "meshband", "version": version } },
        "components": components, "dependencies": dependencies,
    }))
}
