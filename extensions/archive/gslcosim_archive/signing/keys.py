"""Ed25519 keys in the files of OpenSSH, and signatures that `ssh-keygen -Y verify` checks too."""

import base64
import binascii
import hashlib
import os
import re
import struct
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from gslcosim.base.errors import UsageError, build_machine_error
from gslcosim.base.files import read_regular_file
from gslcosim.base.untrusted_input import MalformedFileError

NAMESPACE, NOTE_NAMESPACE = "gslcosim-results", "gslcosim-note"
"""Purpose of signatures of results, as `ssh-keygen -Y verify -n` names it: none for another purpose counts as one."""

_KIND = b"ssh-ed25519"
_MAGIC = b"SSHSIG"
_HASH = b"sha256"
_KEY_BYTES, _SIGNATURE_BYTES, _DIGEST_BYTES = 32, 64, 32
_MAX_FILE_BYTES = 64_000
_BEGIN, _END = "-----BEGIN SSH SIGNATURE-----", "-----END SSH SIGNATURE-----"
_COLUMNS = 70
_MAX_LISTED = 8
_FINGERPRINT = re.compile(r"SHA256:[A-Za-z0-9+/]{43}")


class SignatureError(UsageError):
    """Signed content is not what its author has signed, or it is somebody else's; the user takes it from a copy."""


def build_change_error(place: Path, expected: str, problems: Sequence[str], *, remedy: str) -> SignatureError:
    """Return an error that lists what differs from what was signed.

    Args:
        problems: What differs, a line each; the first ones are listed.
    """
    more = [f"and {len(problems) - _MAX_LISTED} more"] if len(problems) > _MAX_LISTED else []
    where = "place" if len(problems) == 1 else "places"
    listed = "\n  - ".join([*problems[:_MAX_LISTED], *more])
    return SignatureError(f"{place}: expected {expected}, differs in {len(problems)} {where}. {remedy}\n  - {listed}")


@dataclass(frozen=True)
class PublicKey:
    """Public key of an author: 32 bytes."""

    raw: bytes

    @property
    def text(self) -> str:
        """The key as files of OpenSSH have it, without a comment."""
        return f"{_KIND.decode()} {base64.b64encode(_encode_key(self.raw)).decode()}"

    @property
    def fingerprint(self) -> str:
        """The key's SHA-256, as `ssh-keygen -l` shows it."""
        digest = hashlib.sha256(_encode_key(self.raw)).digest()
        return f"SHA256:{base64.b64encode(digest).decode().rstrip('=')}"


def write_key(path: Path, comment: str) -> PublicKey:
    """Make a new key: the private one in a file that its owner alone reads, the public one beside it with `.pub`."""
    ed25519, serialization, _ = _load_cryptography()
    check_text(comment, "--name")
    public_path = path.with_name(f"{path.name}.pub")
    if found := next((each for each in (path, public_path) if os.path.lexists(each)), None):
        raise UsageError(f"{found}: expected the name of a new key, was a file that is there. Choose another name.")
    private = ed25519.Ed25519PrivateKey.generate()
    content = private.private_bytes(
        serialization.Encoding.PEM, serialization.PrivateFormat.OpenSSH, serialization.NoEncryption()
    )
    key = _public_part(private)
    try:
        with os.fdopen(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "wb") as file:
            file.write(content)
        public_path.write_text(f"{key.text} {comment}".rstrip() + "\n", encoding="utf-8")
    except OSError as error:
        raise build_machine_error(error, "key", "a file that can be written", path=path) from error
    return key


def check_text(text: str, option: str) -> None:
    """Refuse a text of the command line that is no UTF-8."""
    try:
        text.encode()
    except UnicodeEncodeError as error:
        raise UsageError(f"{option}: expected a text in UTF-8, was {text!a}. Type it anew.") from error


def read_public_part(key_path: Path) -> PublicKey:
    """Return the public part of a private key; as `sign_digest`."""
    return _public_part(_load_private(key_path))


def sign_digest(digest: bytes, key_path: Path, *, namespace: str = NAMESPACE) -> tuple[str, PublicKey]:
    """Return the signature of a SHA-256 in the text form of OpenSSH, and the key that checks it.

    Args:
        digest: 32 bytes.
        key_path: File of an Ed25519 key without a passphrase, as `write_key` or ssh-keygen write it.
    """
    private = _load_private(key_path)
    key = _public_part(private)
    blob = (
        _MAGIC
        + struct.pack(">I", 1)
        + _pack(_encode_key(key.raw), namespace.encode(), b"", _HASH)
        + _pack(_pack(_KIND, private.sign(_build_message(digest, namespace))))
    )
    text = base64.b64encode(blob).decode()
    lines = [text[i : i + _COLUMNS] for i in range(0, len(text), _COLUMNS)]
    return "\n".join([_BEGIN, *lines, _END, ""]), key


def _load_private(key_path: Path) -> Any:
    ed25519, serialization, _ = _load_cryptography()
    expected = f"{key_path}: expected the private part of an Ed25519 key without a passphrase"
    remedy = "Make one: gslcosim bench keygen FILE."
    try:
        private = serialization.load_ssh_private_key(_read(key_path), password=None)
    # What a file can be wrong in is of many classes, some of them those of parsers below.
    except Exception as error:
        raise UsageError(f"{expected}, was a file without one ({error}). {remedy}") from error
    if not isinstance(private, ed25519.Ed25519PrivateKey):
        raise UsageError(f"{expected}, was one of another kind. {remedy}")
    return private


def check_digest(digest: bytes, signature: str, *, place: str, namespace: str = NAMESPACE) -> PublicKey:
    """Return the key whose owner has signed a SHA-256.

    Args:
        digest: 32 bytes.
        signature: As `sign_digest` returns it.
    """
    ed25519, _, exceptions = _load_cryptography()
    expected = f"{place}: expected a signature of OpenSSH by an Ed25519 key for {namespace}"
    try:
        key, signed = _parse_signature(signature, namespace)
    except (ValueError, struct.error, binascii.Error) as error:
        raise SignatureError(f"{expected}, was {error}. Take the file from a copy.") from error
    try:
        ed25519.Ed25519PublicKey.from_public_bytes(key.raw).verify(signed, _build_message(digest, namespace))
    except (exceptions.InvalidSignature, ValueError) as error:
        raise SignatureError(
            f"{place}: expected the signature of what stands beside it, was one of something else. One of the two was "
            "altered after it was signed: take both from a copy."
        ) from error
    return key


def parse_author(text: str) -> str:
    """Return the fingerprint of an author that a command line names.

    Args:
        text: A fingerprint (`SHA256:…`), a public key (`ssh-ed25519 …`), or a file with one.
    """
    if _FINGERPRINT.fullmatch(text):
        return text
    words = text.split()
    if words[:1] != [_KIND.decode()]:
        try:
            words = _read(Path(text)).decode("utf-8", errors="replace").split()
        except (OSError, ValueError):
            words = []
    try:
        if len(words) < 2 or words[0] != _KIND.decode():
            raise ValueError("no key")
        kind, raw = _unpack(base64.b64decode(words[1], validate=True), 2)
        if kind != _KIND or len(raw) != _KEY_BYTES:
            raise ValueError("another kind of key")
    except (ValueError, struct.error, binascii.Error) as error:
        raise UsageError(
            f"--author: expected an Ed25519 key of OpenSSH, its fingerprint (SHA256:…) or a file with it (.pub), was "
            f"'{text}'. The author publishes it; bench sign prints it."
        ) from error
    return PublicKey(raw).fingerprint


# The text has one form only, so that no altered one passes for the same.
def _parse_signature(text: str, purpose: str) -> tuple[PublicKey, bytes]:
    lines = text.split("\n")
    if lines[0] != _BEGIN or lines[-2:] != [_END, ""]:
        raise ValueError("text without its first and last line")
    packed = "".join(lines[1:-2])
    blob = base64.b64decode(packed, validate=True)
    is_usual = base64.b64encode(blob).decode() == packed and all(len(line) == _COLUMNS for line in lines[1:-3])
    if not is_usual or not 0 < len(lines[-3]) <= _COLUMNS:
        raise ValueError("text in another form")
    head = len(_MAGIC) + 4
    if blob[:head] != _MAGIC + struct.pack(">I", 1):
        raise ValueError("one of another version")
    public, namespace, reserved, hash_name, signed = _unpack(blob[head:], 5)
    if (namespace, reserved, hash_name) != (purpose.encode(), b"", _HASH):
        raise ValueError("one for another purpose")
    (kind, raw), (signed_kind, signature) = _unpack(public, 2), _unpack(signed, 2)
    if kind != _KIND or signed_kind != _KIND or (len(raw), len(signature)) != (_KEY_BYTES, _SIGNATURE_BYTES):
        raise ValueError("one by another kind of key")
    return PublicKey(raw), signature


def _encode_key(raw: bytes) -> bytes:
    return _pack(_KIND, raw)


# What the key signs: PROTOCOL.sshsig of OpenSSH.
def _build_message(digest: bytes, namespace: str) -> bytes:
    if len(digest) != _DIGEST_BYTES:
        raise ValueError(f"expected a SHA-256, was {len(digest)} bytes")
    return _MAGIC + _pack(namespace.encode(), b"", _HASH, digest)


def _pack(*parts: bytes) -> bytes:
    return b"".join(struct.pack(">I", len(part)) + part for part in parts)


def _unpack(data: bytes, n: int) -> list[bytes]:
    parts, at = [], 0
    for _ in range(n):
        (size,) = struct.unpack_from(">I", data, at)
        if size > len(data) - at - 4:
            raise ValueError("text that is cut off")
        parts.append(data[at + 4 : at + 4 + size])
        at += 4 + size
    if at != len(data):
        raise ValueError("text with more behind it")
    return parts


def _public_part(private: Any) -> PublicKey:
    return PublicKey(private.public_key().public_bytes_raw())


def _read(path: Path) -> bytes:
    return read_regular_file(path, max_bytes=_MAX_FILE_BYTES)


def _load_cryptography() -> tuple[Any, Any, Any]:
    try:
        from cryptography import exceptions
        from cryptography.hazmat.primitives import serialization
        from cryptography.hazmat.primitives.asymmetric import ed25519
    except ModuleNotFoundError as error:
        raise UsageError(
            "signatures: expected cryptography, was not installed. Install it: pip install 'gslcosim-archive[sign]'"
        ) from error
    return ed25519, serialization, exceptions


def read_signature(path: Path) -> str:
    """Return the text of a signature's file."""
    try:
        return _read(path).decode("ascii")
    except (OSError, UnicodeDecodeError) as error:
        raise MalformedFileError(
            f"{path}: expected the text of a signature, was something else ({error}). Take the file from a copy."
        ) from error
