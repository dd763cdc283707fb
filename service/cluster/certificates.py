"""Makes the certificates of a cluster: an authority of its own, and one certificate for each role."""

from __future__ import annotations

import os
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import TYPE_CHECKING

from service.cluster.security import ClusterError

if TYPE_CHECKING:
    from cryptography.hazmat.primitives.asymmetric.ec import EllipticCurvePrivateKey
    from cryptography.x509 import Certificate

ROLES = ("scheduler", "worker", "service")


def make_certificates(folder: Path, days: int) -> list[Path]:
    """Writes ca.pem, ca.key and a .pem and .key of each role; keys are readable by their owner alone.

    A folder that has an authority keeps it: only certificates of roles are made anew. Raises ClusterError.
    """
    try:
        from cryptography import x509
        from cryptography.hazmat.primitives import serialization
    except ImportError:
        raise ClusterError("certificates need the package cryptography: pip install 'fredholm[cluster]'") from None
    folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    authority, authority_key = folder / "ca.pem", folder / "ca.key"
    if authority.exists() != authority_key.exists():
        missing = authority_key if authority.exists() else authority
        raise ClusterError(f"{missing} is missing beside its other half; take a new folder, or put it back")
    made: list[Path] = []
    if authority.exists():
        ca = x509.load_pem_x509_certificate(authority.read_bytes())
        ca_key = serialization.load_pem_private_key(authority_key.read_bytes(), None)
    else:
        ca_key = _key()
        ca = _certificate("authority", ca_key, None, ca_key, days)
        made += [_write_key(authority_key, ca_key), _write(authority, _pem(ca))]
    for role in ROLES:
        key = _key()
        signed = _certificate(role, key, ca, ca_key, days)  # type: ignore[arg-type]
        made += [_write_key(folder / f"{role}.key", key), _write(folder / f"{role}.pem", _pem(signed))]
    return made


def _key() -> EllipticCurvePrivateKey:
    from cryptography.hazmat.primitives.asymmetric import ec

    return ec.generate_private_key(ec.SECP256R1())


def _certificate(
    role: str,
    key: EllipticCurvePrivateKey,
    ca: Certificate | None,
    ca_key: EllipticCurvePrivateKey,
    days: int,
) -> Certificate:
    from cryptography import x509
    from cryptography.hazmat.primitives import hashes
    from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

    name = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, f"fredholm {role}")])
    now, is_ca = datetime.now(UTC), ca is None
    ends = now + timedelta(days=days) if ca is None else min(now + timedelta(days=days), ca.not_valid_after_utc)
    usage = x509.KeyUsage(not is_ca, False, False, False, False, is_ca, is_ca, False, False)
    issuer = x509.AuthorityKeyIdentifier.from_issuer_public_key(ca_key.public_key())
    builder = (
        x509.CertificateBuilder()
        .subject_name(name)
        .issuer_name(name if ca is None else ca.subject)
        .public_key(key.public_key())
        .serial_number(x509.random_serial_number())
        .not_valid_before(now - timedelta(hours=1))  # clocks differ
        .not_valid_after(ends)
        .add_extension(x509.BasicConstraints(is_ca, 0 if is_ca else None), critical=True)
        .add_extension(usage, critical=True)
        .add_extension(x509.SubjectKeyIdentifier.from_public_key(key.public_key()), critical=False)
        .add_extension(issuer, critical=False)
    )
    if not is_ca:
        # All of them both listen and connect.
        both = x509.ExtendedKeyUsage([ExtendedKeyUsageOID.SERVER_AUTH, ExtendedKeyUsageOID.CLIENT_AUTH])
        builder = builder.add_extension(both, critical=False)
    return builder.sign(ca_key, hashes.SHA256())


def _pem(certificate: Certificate) -> bytes:
    from cryptography.hazmat.primitives.serialization import Encoding

    return certificate.public_bytes(Encoding.PEM)


def _write_key(path: Path, key: EllipticCurvePrivateKey) -> Path:
    from cryptography.hazmat.primitives.serialization import Encoding, NoEncryption, PrivateFormat

    return _write(path, key.private_bytes(Encoding.PEM, PrivateFormat.PKCS8, NoEncryption()), 0o600)


def _write(path: Path, content: bytes, mode: int = 0o644) -> Path:
    path.unlink(missing_ok=True)
    with os.fdopen(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, mode), "wb") as file:
        file.write(content)
    return path
