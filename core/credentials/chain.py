"""Keys and certificate chains that Content Credentials are signed with (C2PA 2.2, section 14.5)."""

from dataclasses import dataclass
from datetime import datetime, timedelta
from itertools import pairwise

from cryptography import x509
from cryptography.exceptions import InvalidSignature
from cryptography.hazmat.primitives.asymmetric.ec import (
    SECP256R1,
    EllipticCurvePrivateKey,
    EllipticCurvePublicKey,
    generate_private_key,
)
from cryptography.hazmat.primitives.hashes import SHA256
from cryptography.hazmat.primitives.serialization import (
    Encoding,
    NoEncryption,
    PrivateFormat,
    load_pem_private_key,
)
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID, ObjectIdentifier

C2PA_SIGNING = ObjectIdentifier("1.3.6.1.4.1.62558.2.1")
DOCUMENT_SIGNING = ObjectIdentifier("1.3.6.1.5.5.7.3.36")
PURPOSES = {C2PA_SIGNING, DOCUMENT_SIGNING, ExtendedKeyUsageOID.EMAIL_PROTECTION}
SELF_SIGNED_DAYS, BACKDATED = 365, timedelta(minutes=5)  # the latter for clocks that differ
ORGANISATION = "Meshmark self-signed"


class UnusableChainError(Exception):
    """A key and a chain that nothing can be signed with, in one sentence for the operator."""


@dataclass(frozen=True)
class Chain:
    """A key with its certificates, checked.

    Attributes:
        key: PEM of the private key, PKCS #8.
        certificates: PEM, the signer's own first, each signed by the next.
        expires: the moment from which on the first of them to expire is not valid.
    """

    key: bytes
    certificates: bytes
    expires: datetime


def read_chain(certificates: bytes, key: bytes, moment: datetime) -> Chain:
    """Check that results can be signed at a moment with a key and its chain, both PEM.

    Raises:
        UnusableChainError: they cannot, and why.
    """
    private, chain = _private_key(key), _certificates(certificates)
    leaf, public = chain[0], private.public_key().public_numbers()
    certified = leaf.public_key()
    if not isinstance(certified, EllipticCurvePublicKey) or certified.public_numbers() != public:
        raise UnusableChainError("The key is not that of the chain's first certificate.")
    if len(chain) < 2:
        raise UnusableChainError("The chain has one certificate only: the issuer's must follow the signer's own.")
    for certificate, issuer in pairwise(chain):
        try:
            certificate.verify_directly_issued_by(issuer)
        except (ValueError, TypeError, InvalidSignature):
            raise UnusableChainError(
                f"In the chain, {_name(certificate)} is not signed by {_name(issuer)}, which follows it."
            ) from None
    for certificate in chain:
        if moment >= certificate.not_valid_after_utc:
            raise UnusableChainError(f"{_name(certificate)} expired on {certificate.not_valid_after_utc:%Y-%m-%d}.")
        if moment < certificate.not_valid_before_utc:
            raise UnusableChainError(f"{_name(certificate)} begins on {certificate.not_valid_before_utc:%Y-%m-%d}.")
    if not _may_sign(leaf):
        raise UnusableChainError(
            f"{_name(leaf)} is not for signing content: it takes the key usage digitalSignature, and one of the "
            "extended key usages C2PA signing, document signing and e-mail protection."
        )
    pem = private.private_bytes(Encoding.PEM, PrivateFormat.PKCS8, NoEncryption())
    return Chain(pem, certificates, min(one.not_valid_after_utc for one in chain))


def self_signed(moment: datetime) -> Chain:
    """A new key with a chain that nobody but its maker trusts, for tests; it holds for a year."""
    root_key, key = generate_private_key(SECP256R1()), generate_private_key(SECP256R1())
    root_name, name = _subject("root for tests"), _subject("signer for tests")
    root = _certificate(root_name, root_name, root_key, root_key, moment)
    leaf = _certificate(name, root_name, key, root_key, moment)
    return Chain(
        key.private_bytes(Encoding.PEM, PrivateFormat.PKCS8, NoEncryption()),
        leaf.public_bytes(Encoding.PEM) + root.public_bytes(Encoding.PEM),
        leaf.not_valid_after_utc,
    )


def _private_key(pem: bytes) -> EllipticCurvePrivateKey:
    try:
        key = load_pem_private_key(pem, password=None)
    except (ValueError, TypeError):
        raise UnusableChainError("The key is no private key in PEM without a password.") from None
    if not isinstance(key, EllipticCurvePrivateKey) or not isinstance(key.curve, SECP256R1):
        raise UnusableChainError("The key is not of the curve P-256.")
    return key


def _certificates(pem: bytes) -> list[x509.Certificate]:
    try:
        return x509.load_pem_x509_certificates(pem)
    except ValueError:
        raise UnusableChainError("The chain holds no certificates in PEM.") from None


def _may_sign(leaf: x509.Certificate) -> bool:
    extensions = leaf.extensions
    try:
        usage = extensions.get_extension_for_class(x509.KeyUsage).value
        purposes = extensions.get_extension_for_class(x509.ExtendedKeyUsage).value
    except x509.ExtensionNotFound:
        return False
    return usage.digital_signature and not PURPOSES.isdisjoint(purposes)


def _name(certificate: x509.Certificate) -> str:
    return f'the certificate "{certificate.subject.rfc4514_string()}"'


def _subject(name: str) -> x509.Name:
    return x509.Name(
        [x509.NameAttribute(NameOID.ORGANIZATION_NAME, ORGANISATION), x509.NameAttribute(NameOID.COMMON_NAME, name)]
    )


def _certificate(
    subject: x509.Name,
    issuer: x509.Name,
    key: EllipticCurvePrivateKey,
    issuer_key: EllipticCurvePrivateKey,
    moment: datetime,
) -> x509.Certificate:
    is_root = subject == issuer
    usage = x509.KeyUsage(
        digital_signature=not is_root,
        key_cert_sign=is_root,
        crl_sign=is_root,
        content_commitment=False,
        key_encipherment=False,
        data_encipherment=False,
        key_agreement=False,
        encipher_only=False,
        decipher_only=False,
    )
    builder = (
        x509.CertificateBuilder()
        .subject_name(subject)
        .issuer_name(issuer)
        .public_key(key.public_key())
        .serial_number(x509.random_serial_number())
        .not_valid_before(moment - BACKDATED)
        .not_valid_after(moment + timedelta(days=SELF_SIGNED_DAYS))
        .add_extension(x509.BasicConstraints(ca=is_root, path_length=None), critical=True)
        .add_extension(usage, critical=True)
        .add_extension(x509.SubjectKeyIdentifier.from_public_key(key.public_key()), critical=False)
        .add_extension(x509.AuthorityKeyIdentifier.from_issuer_public_key(issuer_key.public_key()), critical=False)
    )
    if not is_root:
        builder = builder.add_extension(x509.ExtendedKeyUsage([ExtendedKeyUsageOID.EMAIL_PROTECTION]), critical=False)
    return builder.sign(issuer_key, SHA256())
