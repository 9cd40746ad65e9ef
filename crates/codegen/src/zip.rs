//! Zip archives of stored (uncompressed) files, as NumPy reads them.
//!
//! APPNOTE.TXT, the zip file format specification: sections 4.3.7 (local headers), 4.3.12 (central directory), 4.3.16 (its end).

/// An archive in memory. Names are ASCII; every file and the archive are below 4 GiB.
pub(crate) fn archive(files: &[(String, Vec<u8>)]) -> Vec<u8> {
    let (mut out, mut directory) = (Vec::new(), Vec::new());
    for (name, bytes) in files {
        let offset = out.len();
        let mut fields = Vec::new();
        // Version 2.0; no flags; stored; midnight of 1 January 1980, so that equal models make equal files.
        for word in [20u16, 0, 0, 0, 0x21] {
            fields.extend(word.to_le_bytes());
        }
        let length = bytes.len() as u32;
        for word in [crc32fast::hash(bytes), length, length] {
            fields.extend(word.to_le_bytes());
        }
        for word in [name.len() as u16, 0] {
            fields.extend(word.to_le_bytes());
        }
        out.extend(0x0403_4b50u32.to_le_bytes());
        out.extend(&fields);
        out.extend(name.as_bytes());
        out.extend(bytes);
        directory.extend(0x0201_4b50u32.to_le_bytes());
        directory.extend(20u16.to_le_bytes());
        directory.extend(&fields);
        // No comment, disk 0, no attributes.
        directory.extend([0u8; 10]);
        directory.extend((offset as u32).to_le_bytes());
        directory.extend(name.as_bytes());
    }
    let start = out.len() as u32;
    let size = directory.len() as u32;
    out.extend(directory);
    out.extend(0x0605_4b50u32.to_le_bytes());
    let count = files.len() as u16;
    for word in [0u16, 0, count, count] {
        out.extend(word.to_le_bytes());
    }
    out.extend(size.to_le_bytes());
    out.extend(start.to_le_bytes());
    out.extend(0u16.to_le_bytes());
    out
}
