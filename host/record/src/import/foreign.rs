//! Formats that are known by sight and not read: what the file is, and how it becomes one that is.

use crate::Error;
use std::path::Path;

/// What a file of no known format is told.
pub(super) const REFUSAL: &str = "is not mat, HDF5, TDMS, mf4, Parquet, Feather, lvm, csv, csv.gz, wav, FLAC, npy or \
    uff58; export it as one of these";

/// The refusal of a format that is known and not read.
pub(super) fn known(path: &Path, bytes: &[u8], name: &str) -> Option<Error> {
    let begins = |magic: &[u8]| bytes.starts_with(magic);
    let ends = |ending: &str| name.ends_with(ending);
    let version = |at: usize| String::from_utf8_lossy(bytes.get(at..at + 4).unwrap_or_default()).trim().to_owned();
    let what = if begins(b"UnFinMF ") {
        format!(
            "is an ASAM MDF file that was not closed; close it: python -m pip install asammdf, then \
             asammdf.MDF('{name}').save('out.mf4')"
        )
    } else if begins(b"MDF     ") {
        format!(
            "is an ASAM MDF {} file, of which version 4 is read; convert it: python -m pip install asammdf, then \
             asammdf.MDF('{name}').convert('4.10').save('out.mf4')",
            version(8)
        )
    } else if begins(b"FEA1") {
        format!("is a Feather file of version 1; convert it: pandas.read_feather('{name}').to_parquet('out.parquet')")
    } else if begins(b"PK\x03\x04") && (ends(".npz") || bytes.windows(4).take(200).any(|w| w == b".npy")) {
        format!(
            "is a NumPy archive (npz); save its arrays one by one: numpy.save('out.npy', numpy.load('{name}')['ARRAY'])"
        )
    } else if begins(b"PK\x03\x04") && (ends(".xlsx") || ends(".ods")) {
        "is a spreadsheet; save the sheet as csv".into()
    } else if begins(b"PK\x03\x04") {
        "is a zip archive; unpack it first".into()
    } else if begins(b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1") {
        "is an old Office file; save the sheet as csv".into()
    } else if begins(b"\x1a\x45\xdf\xa3") || ends(".ide") {
        format!(
            "is an EBML recording (enDAQ IDE), which is not read; convert it: idelib's ideexport '{name}', which \
             writes csv"
        )
    } else if begins(b"\x80\x04") || begins(b"\x80\x03") || begins(b"\x80\x05") || ends(".pkl") {
        "is a Python pickle, which may run anything when it is read; save the arrays with numpy.save".into()
    } else if begins(b"CDF\x01") || begins(b"CDF\x02") {
        format!("is a classic NetCDF file, which is not read; convert it to NetCDF 4: nccopy -k nc4 '{name}' out.nc")
    } else if begins(b"Rar!")
        || begins(b"7z\xbc\xaf")
        || begins(b"BZh")
        || begins(b"\xfd7zXZ")
        || begins(b"\x28\xb5\x2f\xfd")
    {
        "is a compressed archive; unpack it first (gzip is read as it is)".into()
    } else if begins(b"OggS") || begins(b"ID3") || begins(b"\xff\xfb") {
        "is compressed sound with losses, which is no measurement; record as wav or FLAC".into()
    } else if begins(b"FORM") && bytes.get(8..11) == Some(b"AIF") {
        format!("is an AIFF file, which is not read; convert it: sox '{name}' out.wav")
    } else if begins(b"SQLite format 3") {
        "is a database; export the table as csv".into()
    } else if begins(b"DEWE") || ends(".dxd") || ends(".d7d") || ends(".dmd") {
        "is a DEWESoft or Dewetron recording; export it as mat, csv or uff58".into()
    } else if ends(".hpf") || ends(".sie") || ends(".rec") || ends(".bkc") {
        "is a logger's own format; export it as mat, csv, wav or uff58".into()
    } else {
        return None;
    };
    Some(Error::invalid(path.display(), what))
}
