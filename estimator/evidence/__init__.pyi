from .history import (
    AccountHistory as AccountHistory,
    CollectedAccounts as CollectedAccounts,
    KeptAccounts as KeptAccounts,
)
