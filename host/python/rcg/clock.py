"""What time it is, and where: the library has no clock."""

import os
import platform
from datetime import UTC, datetime


def now() -> str:
    """The time now, UTC, as RFC 3339 writes it; ``SOURCE_DATE_EPOCH`` stands for it where it is set."""
    epoch = os.environ.get("SOURCE_DATE_EPOCH")
    try:
        moment = datetime.now(UTC) if epoch is None else datetime.fromtimestamp(int(epoch), UTC)
    except (ValueError, OverflowError, OSError) as error:
        raise ValueError(f"SOURCE_DATE_EPOCH: expected seconds since 1970, found {epoch}") from error
    return moment.strftime("%Y-%m-%dT%H:%M:%SZ")


def host() -> str | None:
    """Name of this computer, as far as it says one."""
    return platform.node() or None
