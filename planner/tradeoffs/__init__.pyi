from .limit_worth import ALL as ALL, LimitChange as LimitChange, Worth as Worth, find_worth as find_worth
