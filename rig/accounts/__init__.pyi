from .account_file import (
    FILE_NAME as FILE_NAME,
    Account as Account,
    AccountFile as AccountFile,
    AccountsError as AccountsError,
    name_key as name_key,
)
from .attempts import Attempts as Attempts, TooManyAttemptsError as TooManyAttemptsError
from .passwords import Passwords as Passwords, checked_password as checked_password
from .roles import Role as Role, refusals as refusals, why_not as why_not
