"""The paper (Erkaya and Uzmay 2009): its printed numbers and claims beside ours; nothing here is tuned to match."""
