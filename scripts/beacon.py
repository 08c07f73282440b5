"""Public randomness of drand's quicknet: one signature every three seconds, which nobody can know before its time.

A round's signature is read by hand where there is no network (`https://api.drand.sh/CHAIN/public/ROUND` has it) and
checked against the public key of the chain without one (scheme bls-unchained-g1-rfc9380; py-ecc, extra `season`).
"""

import hashlib
from datetime import UTC, datetime

from dexgrasp_env.errors import InputError
from dexgrasp_env.extras import from_extra

CHAIN = "52db9ba70e0cc0f6eaf7803dd07447a1f5477735fd3f661792ba94600c84e971"
_KEY = bytes.fromhex(
    "83cf0f2896adee7eb8b5f01fcad3912212c437e0073e911fb90022d3e760183c8c4b450b6a0a6c3ac6a5776a2d1064510d1fec758c921cc2"
    "2b0e17e63aaf4bcb5ed66304de9cf809bd274ca73bab4af5a6e9c76a4bc09e76eae8991ef5ece45a"
)
_GENESIS, _PERIOD = 1692803367, 3  # s since 1970; s a round
_DOMAIN = b"BLS_SIG_BLS12381G1_XMD:SHA-256_SSWU_RO_NUL_"


def round_time(number: int) -> datetime:
    """Return when a round is published."""
    return datetime.fromtimestamp(_GENESIS + (number - 1) * _PERIOD, UTC)


def randomness(number: int, signature: str) -> str:
    """Return the randomness of a round, 64 hexadecimal digits.

    Args:
        number: of the round.
        signature: of the round, 96 hexadecimal digits.

    Raises:
        InputError: unless the signature is the chain's for this round.
    """
    with from_extra():
        from py_ecc.bls.hash_to_curve import hash_to_G1
        from py_ecc.bls.point_compression import decompress_G1, decompress_G2
        from py_ecc.optimized_bls12_381 import G2, pairing

    message = hash_to_G1(hashlib.sha256(number.to_bytes(8, "big")).digest(), _DOMAIN, hashlib.sha256)
    key = decompress_G2((int.from_bytes(_KEY[:48], "big"), int.from_bytes(_KEY[48:], "big")))
    try:
        data = bytes.fromhex(signature)
        genuine = len(data) == 48 and pairing(G2, decompress_G1(int.from_bytes(data, "big"))) == pairing(
            key, message
        )
    except ValueError:
        genuine = False
    if not genuine:
        raise InputError(f"this is not the signature of round {number} of drand's quicknet ({CHAIN[:8]}...)")
    return hashlib.sha256(data).hexdigest()
