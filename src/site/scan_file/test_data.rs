//! Small scans for tests.

use super::{ScanError, ScanGeometry, read};

/// Reads bytes from a file with this name.
pub fn read_bytes(name: &str, bytes: &[u8]) -> Result<ScanGeometry, ScanError> {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join(name);
    std::fs::write(&file, bytes).unwrap();
    read(&file)
}

/// The message without the folder.
pub fn refusal(name: &str, bytes: &[u8]) -> String {
    let error = read_bytes(name, bytes).unwrap_err().to_string();
    error[error.find(name).unwrap()..].to_owned()
}

/// A file of format 1 with records and points.
pub fn las_file(records: &[(&str, u16, &[u8])], points: &[[i32; 3]]) -> Vec<u8> {
    let mut file = vec![0; 227];
    for (user, number, data) in records {
        let mut header = [0; 54];
        header[2..2 + user.len()].copy_from_slice(user.as_bytes());
        header[18..20].copy_from_slice(&number.to_le_bytes());
        header[20..22].copy_from_slice(&(data.len() as u16).to_le_bytes());
        file.extend(header);
        file.extend(*data);
    }
    let points_at = file.len() as u32;
    for point in points {
        let mut record = [0; 28];
        for (bytes, value) in record.chunks_exact_mut(4).zip(point) {
            bytes.copy_from_slice(&value.to_le_bytes());
        }
        file.extend(record);
    }
    let mut put = |at: usize, bytes: &[u8]| file[at..at + bytes.len()].copy_from_slice(bytes);
    put(0, b"LASF");
    put(24, &[1, 2]);
    put(94, &227u16.to_le_bytes());
    put(96, &points_at.to_le_bytes());
    put(100, &(records.len() as u32).to_le_bytes());
    put(104, &[1, 28, 0]);
    put(107, &(points.len() as u32).to_le_bytes());
    for (n, value) in [0.001f64, 0.001, 0.01, 500_000.0, 4_000_000.0, -10.0].into_iter().enumerate() {
        put(131 + 8 * n, &value.to_le_bytes());
    }
    file
}
