"""Certificates for tests of TLS, made by openssl: a CA, and the certificates that it signs. EC P-256 [MB-TLS R-61]."""

from __future__ import annotations

import subprocess
from pathlib import Path

ROLE = "1.3.6.1.4.1.50316.802.1"


def openssl(*arguments: str, where: Path) -> None:
    subprocess.run(["openssl", *arguments], cwd=where, check=True, capture_output=True)


def authority(where: Path, name: str = "ca") -> None:
    """A certificate authority: NAME.crt, NAME.key."""
    (where / f"{name}.cnf").write_text(
        f"[req]\ndistinguished_name=dn\nprompt=no\nx509_extensions=v3\n[dn]\nCN={name}\n"
        "[v3]\nbasicConstraints=critical,CA:TRUE\nkeyUsage=critical,keyCertSign,cRLSign\nsubjectKeyIdentifier=hash\n"
    )
    key = ["-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:P-256", "-nodes", "-keyout", f"{name}.key"]
    openssl("req", "-x509", *key, "-out", f"{name}.crt", "-days", "3650", "-config", f"{name}.cnf", where=where)


def leaf(
    where: Path, name: str, *, role: str | None = None, server: bool = False, days: int = 3650, ca: str = "ca"
) -> None:
    """NAME.crt and NAME.key, signed by the CA; with `days=-1` it is already expired. `role` is a text, or an ASN.1
    value in the notation of openssl."""
    rows = ["[e]", "basicConstraints=critical,CA:FALSE", "keyUsage=critical,digitalSignature"]
    rows += ["subjectKeyIdentifier=hash", "authorityKeyIdentifier=keyid"]
    rows.append(f"extendedKeyUsage={'serverAuth' if server else 'clientAuth'}")
    if server:
        rows.append("subjectAltName=IP:127.0.0.1,DNS:localhost")
    if role is not None:
        rows.append(f"{ROLE}=ASN1:{role if ':' in role else f'UTF8String:{role}'}")
    (where / f"{name}.ext").write_text("\n".join(rows) + "\n")
    key = ["-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:P-256", "-nodes", "-keyout", f"{name}.key"]
    openssl("req", "-new", *key, "-subj", f"/CN={name}", "-out", f"{name}.csr", where=where)
    signed = ["-req", "-in", f"{name}.csr", "-CA", f"{ca}.crt", "-CAkey", f"{ca}.key", "-CAcreateserial"]
    extensions = ["-extfile", f"{name}.ext", "-extensions", "e"]
    openssl("x509", *signed, "-out", f"{name}.crt", "-days", str(days), *extensions, where=where)


def tls_url(where: Path, name: str, place: str = "127.0.0.1:0", *, ca: str = "ca", **options: str) -> str:
    """A tls:// URL with the files of NAME."""
    files = f"cert={where}/{name}.crt&key={where}/{name}.key&ca={where}/{ca}.crt"
    return f"tls://{place}?{files}" + "".join(f"&{key}={value}" for key, value in options.items())
